//! Recorded and computed outputs of a step, compared.

use message_log::{Difference, Differences, FieldDifference, first_difference};
use shared_types::Message;

/// The replayed process's messages of one topic, beside those of the run.
pub struct Topic {
    /// Name of the topic.
    pub name: &'static str,
    /// Messages compared.
    pub messages: u64,
    /// Tick of the first difference, and the difference.
    pub first: Option<(u64, Difference)>,
    /// Largest difference per field.
    pub fields: Vec<FieldDifference>,
}

/// Recorded and computed messages of one topic, compared.
pub(super) struct Comparison<M> {
    messages: u64,
    first: Option<(u64, Difference)>,
    differences: Differences<M>,
}

impl<M: Message> Default for Comparison<M> {
    fn default() -> Self {
        Self {
            messages: 0,
            first: None,
            differences: Differences::default(),
        }
    }
}

impl<M: Message> Comparison<M> {
    pub(super) fn take(&mut self, recorded: &M, mut computed: M) {
        // The runtime sets the incarnation, not the step.
        computed.header_mut().incarnation = recorded.header().incarnation;
        self.messages += 1;
        if self.first.is_none() {
            self.first = first_difference(recorded, &computed)
                .map(|difference| (recorded.header().tick, difference));
        }
        self.differences.add(recorded, &computed);
    }

    pub(super) fn topic(self) -> Topic {
        Topic {
            name: M::TOPIC,
            messages: self.messages,
            first: self.first,
            fields: self.differences.fields(),
        }
    }
}
