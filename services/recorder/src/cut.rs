//! Cuts: what all processes have saved before a tick, in the record, on the topic `/cuts`. From there a run goes on.

use std::path::Path;

use runtime::NamedSaved;

use crate::contents::Contents;
use crate::error::RecordError;
use crate::event::{CDR, bytes, number, put_bytes, put_text, text};
use crate::reader::{Item, RecordReader};
use crate::ticks::refusal;

/// Topic, type and definition of cuts.
pub(crate) const CUTS: [&str; 3] = [
    "/cuts",
    "armplane/msg/Cut",
    "armplane/Saved[] processes\n\
     ================================================================================\n\
     MSG: armplane/Saved\nstring process\nuint8[] state\n",
];

/// The states of all processes before a tick.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    /// The tick that comes next.
    pub tick: u64,
    /// The processes, and what they have saved, as [`process::Saved`] has it.
    pub processes: Vec<NamedSaved>,
}

impl Cut {
    /// As a message of CDR.
    pub(crate) fn write(&self, out: &mut Vec<u8>) {
        out.extend(CDR);
        out.extend((self.processes.len() as u32).to_le_bytes());
        for (process, saved) in &self.processes {
            put_text(out, process);
            put_bytes(out, saved);
        }
    }

    /// The cut of a tick from its message; `None` of other bytes.
    pub(crate) fn read(tick: u64, message: &[u8]) -> Option<Self> {
        let mut at = CDR.len();
        let count = number(message, &mut at)?;
        let process = |_| Some((text(message, &mut at)?, bytes(message, &mut at)?.to_vec()));
        let processes = (0..count).map(process).collect::<Option<_>>()?;
        Some(Self { tick, processes })
    }

    /// The newest cut of a record at which a run can go on; `None` if it has none. `is_usable` says whether one of a tick is. Behind the first damage
    /// none is: the record would keep the hole.
    ///
    /// # Errors
    /// When the record cannot be read.
    pub fn newest(
        path: &Path,
        contents: &Contents,
        is_usable: impl Fn(u64) -> bool,
    ) -> Result<Option<Self>, RecordError> {
        let mut last = u64::MAX;
        loop {
            let mut record = match RecordReader::open_before(path, contents, last) {
                Ok(record) => record,
                Err(error) => return refusal(error).map(|_| None),
            };
            let mut newest = None;
            while let Some(item) = record.next_item() {
                if let Item::Cut(cut) = item
                    && is_usable(cut.tick)
                {
                    newest = Some(cut);
                }
            }
            match (&newest, record.damage().first()) {
                (Some(cut), Some(damage)) if cut.tick > *damage.start() => last = *damage.start(),
                _ => return Ok(newest),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_comes_back_and_other_bytes_are_none() {
        let cut = Cut {
            tick: 2000,
            processes: vec![("plant".into(), vec![7; 13]), ("controller".into(), vec![])],
        };
        let mut bytes = Vec::new();
        cut.write(&mut bytes);
        assert_eq!(Cut::read(2000, &bytes), Some(cut));
        for end in 0..bytes.len() {
            assert_eq!(Cut::read(2000, &bytes[..end]), None, "{end}");
        }
    }
}
