//! The fingerprint of a topic: a hash over the reproducible bytes of all its messages in order.

use shared_types::summary::TopicSummary;
use shared_types::wire::Stamps;
use xxhash_rust::xxh3::xxh3_64_with_seed;

/// XXH3-64 over the bytes behind the stamps of one message after the other, each seeded with the hash before: two numbers are its whole memory, so
/// that whoever is started again can go on with it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TopicHash {
    digest: u64,
    count: u64,
}

impl TopicHash {
    /// Adds a message; the stamps at its beginning are not reproducible.
    pub fn add(&mut self, message: &[u8]) {
        let content = message.get(size_of::<Stamps>()..).unwrap_or_default();
        self.digest = xxh3_64_with_seed(content, self.digest);
        self.count += 1;
    }

    /// How many messages it covers.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The topic's line in a run's summary.
    pub fn summary(&self) -> TopicSummary {
        TopicSummary {
            count: self.count,
            hash: format!("{:016x}", self.digest),
        }
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
                hash.add(bytemuck::bytes_of(&message));
            }
            hash.summary().hash
        };
        assert_eq!(hash(&[1, 2], 7), hash(&[1, 2], 8));
        assert_ne!(hash(&[1, 2], 7), hash(&[2, 1], 7));
        assert_ne!(hash(&[1, 2], 7), hash(&[1, 2, 3], 7));
    }
}
