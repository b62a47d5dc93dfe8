//! The check at the edge of a process.

use shared_types::topics::{self, Each, Topic};
use shared_types::{Message, SingularityReport};

use super::input::{Bytes, numbers};

/// The check at the edge finds every number that is not finite, and no other.
pub fn validation(bytes: &[u8]) {
    fn check<M: Message>(bytes: &[u8]) {
        let message: M = Bytes(bytes).next();
        let begin = size_of::<shared_types::Header>();
        let numbers = numbers::<M>();
        let number = |message: &M, at: usize| {
            bytemuck::pod_read_unaligned::<f64>(&bytemuck::bytes_of(message)[at..at + 8])
        };
        let is_finite = numbers.iter().all(|at| number(&message, *at).is_finite());
        assert_eq!(message.is_finite(), is_finite, "{message:?}");
        // The rest are integers, and any will do.
        assert!(
            numbers.first().is_some_and(|first| *first >= begin)
                && numbers.len() * 8 <= size_of::<M>() - begin
        );
        let place = bytes.first().map_or(0, |choice| usize::from(*choice)) * numbers.len() / 256;
        for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut poisoned = message;
            bytemuck::bytes_of_mut(&mut poisoned)[numbers[place]..numbers[place] + 8]
                .copy_from_slice(&poison.to_ne_bytes());
            assert!(
                !poisoned.is_finite(),
                "{poison} at byte {} is not seen: {poisoned:?}",
                numbers[place]
            );
        }
    }
    struct CheckEach<'a>(&'a [u8]);
    impl Each for CheckEach<'_> {
        type Output = ();
        fn each<M: Topic>(&mut self) {
            check::<M>(self.0);
        }
    }
    topics::each(&mut CheckEach(bytes));
    let report: SingularityReport = Bytes(bytes).next();
    if let Some(read) = control::wire::report::<6>(&report) {
        assert!(read.count <= shared_types::MAX_SINGULARITIES);
    }
}
