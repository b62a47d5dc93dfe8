//! The fingerprint of a topic: one hash over the reproducible bytes of all its messages, in order.

use shared_types::Message;
use xxhash_rust::xxh3::Xxh3Default;

/// XXH3-64 over [`Message::content`] of one message after the other.
#[derive(Clone, Default)]
pub struct TopicHash {
    hash: Xxh3Default,
    count: u64,
}

impl TopicHash {
    /// Adds a message.
    pub fn add<M: Message>(&mut self, message: &M) {
        self.hash.update(message.content());
        self.count += 1;
    }

    /// How many messages it covers.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The hash so far.
    #[must_use]
    pub fn digest(&self) -> u64 {
        self.hash.digest()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::SensorSample;

    #[test]
    fn content_and_order_count_and_stamps_do_not() {
        let hash = |ticks: &[u64], sent_ns: u64| {
            let mut hash = TopicHash::default();
            for &tick in ticks {
                let mut message = SensorSample::default();
                message.header.tick = tick;
                message.header.stamps.sent_ns[0] = sent_ns;
                hash.add(&message);
            }
            hash.digest()
        };
        assert_eq!(hash(&[1, 2], 7), hash(&[1, 2], 8));
        assert_ne!(hash(&[1, 2], 7), hash(&[2, 1], 7));
        assert_ne!(hash(&[1, 2], 7), hash(&[1, 2, 3], 7));
    }
}
