//! The topics of a process as C sees them, by name.

use std::ffi::CString;

use runtime::{Input, Joined, JoinedError, Output};

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

/// The place among a process's inputs, or outputs, of a topic whose messages have the layout that the program was compiled with; 0: it does not say.
pub(crate) fn find(
    joined: &Joined,
    topic: &str,
    layout: u64,
    is_output: bool,
) -> Result<usize, JoinedError> {
    let process = || joined.shell().name().to_owned();
    let inputs = joined.inputs().iter().map(Input::layout);
    let outputs = joined.outputs().iter().map(Output::layout);
    let (found, key) = match is_output {
        true => (
            outputs.enumerate().find(|(_, one)| one.topic == topic),
            "writes",
        ),
        false => (
            inputs.enumerate().find(|(_, one)| one.topic == topic),
            "reads",
        ),
    };
    match found {
        None => Err(JoinedError::Unlisted {
            process: process(),
            topic: topic.to_owned(),
            key,
        }),
        Some((_, ours)) if layout != 0 && layout != ours.hash => Err(JoinedError::Layout {
            process: process(),
            topic: topic.to_owned(),
            theirs: layout,
            ours: ours.hash,
        }),
        Some((place, _)) => Ok(place),
    }
}
