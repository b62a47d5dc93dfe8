//! The topics of a process as C sees them, by name.

use std::ffi::CString;

use runtime::{Input, Joined, JoinedError, Output};
use shared_types::layout::MessageLayout;

use crate::armplane_process_topic;

/// Descriptions that stay at their places.
pub(crate) struct Topics {
    described: Vec<armplane_process_topic>,
    /// The texts that they point to.
    _texts: Vec<CString>,
}

impl Topics {
    pub(crate) fn of(joined: &Joined) -> Self {
        let (mut described, mut texts) = (Vec::new(), Vec::new());
        let inputs = joined.inputs().iter().map(|input| (input.layout(), 0));
        let outputs = joined.outputs().iter().map(|output| (output.layout(), 1));
        for (layout, is_output) in inputs.chain(outputs) {
            let mut keep = |text: &str| {
                texts.push(CString::new(text).unwrap_or_default());
                texts.last().map_or(std::ptr::null(), |text| text.as_ptr())
            };
            described.push(armplane_process_topic {
                name: keep(&layout.topic),
                type_name: keep(&layout.type_name),
                layout: layout.hash,
                bytes: layout.bytes as u64,
                is_output,
                reserved: 0,
            });
        }
        Self {
            described,
            _texts: texts,
        }
    }

    pub(crate) fn described(&self, index: usize) -> Option<&armplane_process_topic> {
        self.described.get(index)
    }
}

/// A bit for each input that has a message of the tick in hand.
pub(crate) fn fresh(joined: &Joined) -> u64 {
    let bits = joined.inputs().iter().enumerate();
    bits.map(|(place, input)| u64::from(input.is_fresh()) << (place % 64))
        .sum()
}

/// The input of a topic, whose messages have the layout that the program was compiled with.
pub(crate) fn input<'a>(
    joined: &'a mut Joined,
    topic: &str,
    layout: u64,
) -> Result<&'a mut Input, JoinedError> {
    let is_asked = |input: &Input| input.topic() == topic;
    let Some(place) = joined.inputs().iter().position(is_asked) else {
        return Err(unlisted(joined, topic, "reads"));
    };
    check(joined, joined.inputs()[place].layout(), layout)?;
    Ok(&mut joined.inputs_mut()[place])
}

/// The output of a topic, likewise.
pub(crate) fn output<'a>(
    joined: &'a mut Joined,
    topic: &str,
    layout: u64,
) -> Result<&'a mut Output, JoinedError> {
    let is_asked = |output: &Output| output.topic() == topic;
    let Some(place) = joined.outputs().iter().position(is_asked) else {
        return Err(unlisted(joined, topic, "writes"));
    };
    check(joined, joined.outputs()[place].layout(), layout)?;
    Ok(&mut joined.outputs_mut()[place])
}

/// Whether a program uses the layout that its messages have; 0: it does not say.
fn check(joined: &Joined, ours: &MessageLayout, theirs: u64) -> Result<(), JoinedError> {
    if theirs == 0 || theirs == ours.hash {
        return Ok(());
    }
    Err(JoinedError::Layout {
        process: joined.shell().name().to_owned(),
        topic: ours.topic.clone(),
        theirs,
        ours: ours.hash,
    })
}

fn unlisted(joined: &Joined, topic: &str, key: &'static str) -> JoinedError {
    JoinedError::Unlisted {
        process: joined.shell().name().to_owned(),
        topic: topic.to_owned(),
        key,
    }
}
