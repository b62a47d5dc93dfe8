//! The ground truth in a recorder's checkpoint: the memory of the analysis. The rest follows from
//! the scenario.

use bytemuck::{Zeroable, bytes_of, pod_read_unaligned};
use control::GroundTruth;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use shared_types::AnalyzerCheckpoint;

/// The ground truth, or its part in a checkpoint until the scenario is available again.
#[derive(Debug)]
pub(super) enum Ground {
    Present(Box<dyn GroundTruth>),
    Stored(Box<AnalyzerCheckpoint>),
}

impl Ground {
    /// The truth; `None` of a checkpoint that has not been [`resumed`](Self::resumed).
    pub(super) fn truth(&mut self) -> Option<&mut dyn GroundTruth> {
        match self {
            Self::Present(truth) => Some(truth.as_mut()),
            Self::Stored(_) => None,
        }
    }

    /// `truth`, with the memory of a predecessor's.
    pub(super) fn resumed(self, mut truth: Box<dyn GroundTruth>) -> Self {
        if let Self::Stored(memory) = self {
            truth.restore(&memory);
        }
        Self::Present(truth)
    }
}

impl Serialize for Ground {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut memory = AnalyzerCheckpoint::zeroed();
        match self {
            Self::Present(truth) => truth.save(&mut memory),
            Self::Stored(stored) => memory = **stored,
        }
        bytes_of(&memory).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Ground {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let bytes = Vec::<u8>::deserialize(deserializer)?;
        if bytes.len() != size_of::<AnalyzerCheckpoint>() {
            return Err(serde::de::Error::custom("an analysis of another size"));
        }
        Ok(Self::Stored(Box::new(pod_read_unaligned(&bytes))))
    }
}
