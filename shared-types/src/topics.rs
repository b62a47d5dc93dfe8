//! The list of topics, and everything derived from it: a structure with one field per topic, a
//! visitor, the hash of the wire.
//!
//! A new topic is a message in [`messages`](crate::messages) and one line in [`for_each_topic`]; the graph names the process that writes it.

use std::marker::PhantomData;

use crate::layout::MessageLayout;
use crate::messages::{
    ControlState, PlantState, SensorSample, ServoState, SingularityReport, StateEstimate, Target,
    TorqueCommand, WristForce,
};
use crate::wire::Message;

/// The list: each topic with its message, in the order in which a tick's data flows.
macro_rules! for_each_topic {
    ($callback:ident) => {
        $callback! {
            sensor: SensorSample,
            plant_state: PlantState,
            wrist_force: WristForce,
            estimate: StateEstimate,
            singularity: SingularityReport,
            target: Target,
            servo_state: ServoState,
            control_state: ControlState,
            torque: TorqueCommand,
        }
    };
}

macro_rules! derive {
    ($($topic:ident: $message:ident),* $(,)?) => {
        /// The names of all topics, in the order of the list.
        pub const TOPICS: [&str; COUNT] = [$($message::TOPIC),*];

        /// How many topics there are.
        pub const COUNT: usize = [$(stringify!($topic)),*].len();

        $( const _: () = assert!(is_same($message::TOPIC, stringify!($topic)), "the list and the message disagree on the topic's name"); )*

        /// Something of each topic: a message, its hash, its file, its place in a buffer.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct ByTopic<F: Family> {
            $( #[doc = concat!("Of topic `", stringify!($topic), "`: [`", stringify!($message), "`].")] pub $topic: F::Of<$message> ),*
        }

        impl ByTopic<Whole> {
            /// References to all of them.
            #[must_use]
            pub fn lent(&self) -> ByTopic<Lent<'_>> {
                ByTopic { $( $topic: Some(&self.$topic) ),* }
            }

            /// The bytes of each message, in the order of the list.
            #[must_use]
            pub fn parts(&self) -> [&[u8]; COUNT] {
                [$( bytemuck::bytes_of(&self.$topic) ),*]
            }

            /// The same, each to be taken out by who changes it.
            pub fn parts_mut(&mut self) -> [Option<&mut [u8]>; COUNT] {
                [$( Some(bytemuck::bytes_of_mut(&mut self.$topic)) ),*]
            }
        }

        impl ByTopic<Received> {
            /// References to those that have come.
            #[must_use]
            pub fn lent(&self) -> ByTopic<Lent<'_>> {
                ByTopic { $( $topic: self.$topic.as_ref() ),* }
            }
        }

        impl From<&ByTopic<Whole>> for ByTopic<Received> {
            fn from(whole: &ByTopic<Whole>) -> Self {
                Self { $( $topic: Some(whole.$topic) ),* }
            }
        }

        $( impl Topic for $message {
            const INDEX: usize = place($message::TOPIC);

            fn of<F: Family>(all: &ByTopic<F>) -> &F::Of<Self> {
                &all.$topic
            }

            fn of_mut<F: Family>(all: &mut ByTopic<F>) -> &mut F::Of<Self> {
                &mut all.$topic
            }
        } )*

        /// Does something for each topic, in the order of the list, and returns the results.
        pub fn each<E: Each>(work: &mut E) -> [E::Output; COUNT] {
            [$( work.each::<$message>() ),*]
        }

        /// Does something for the topic of that name; `None` if there is none.
        pub fn named<E: Each>(topic: &str, work: &mut E) -> Option<E::Output> {
            match topic {
                $( stringify!($topic) => Some(work.each::<$message>()), )*
                _ => None,
            }
        }
    };
}

for_each_topic!(derive);

/// One type for each message: the entry of a topic in a [`ByTopic`].
pub trait Family {
    /// Its value for the topic of `M`.
    type Of<M: Topic>;
}

/// A message that is in the list.
pub trait Topic: Message {
    /// Its place in [`TOPICS`].
    const INDEX: usize;

    /// A bundle's value for this topic.
    fn of<F: Family>(all: &ByTopic<F>) -> &F::Of<Self>;

    /// A bundle's value for this topic, mutable.
    fn of_mut<F: Family>(all: &mut ByTopic<F>) -> &mut F::Of<Self>;
}

/// Does something for each topic: a closure that is generic over the message.
pub trait Each {
    /// The result for one topic.
    type Output;

    /// Does it for the topic of `M`.
    fn each<M: Topic>(&mut self) -> Self::Output;
}

/// Plain data on the message of a topic.
pub trait OfTopic: Sized {
    /// That of the topic of `M`.
    #[must_use]
    fn of_topic<M: Topic>() -> Self;

    /// Those of all topics, in the order of the list.
    #[must_use]
    fn all() -> [Self; COUNT] {
        each(&mut Data(PhantomData))
    }

    /// That of the topic of that name; `None` if there is none.
    #[must_use]
    fn named(topic: &str) -> Option<Self> {
        named(topic, &mut Data(PhantomData))
    }
}

struct Data<T>(PhantomData<T>);

impl<T: OfTopic> Each for Data<T> {
    type Output = T;

    fn each<M: Topic>(&mut self) -> T {
        T::of_topic::<M>()
    }
}

/// The topics that only a steered run has.
pub const STEERED: [&str; 2] = [Target::TOPIC, ServoState::TOPIC];

/// The topic that only a run has that controls a force.
pub const PRESSING: &str = WristForce::TOPIC;

/// The topics of the control chain in the order of the data: one message of each is once around the loop.
pub const CHAIN: [&str; 4] = [
    SensorSample::TOPIC,
    StateEstimate::TOPIC,
    SingularityReport::TOPIC,
    TorqueCommand::TOPIC,
];

/// Most topics of a run, those of its graph included: each has a bit on every doorbell.
pub const MAX_TOPICS: usize = 29;

const fn is_same(a: &str, b: &str) -> bool {
    let a = a.as_bytes();
    let b = b.as_bytes();
    let mut i = 0;
    while i < a.len() && i < b.len() && a[i] == b[i] {
        i += 1;
    }
    i == a.len() && i == b.len()
}

/// The place of a topic in the list; it does not compile for one that is not there.
const fn place(topic: &str) -> usize {
    let mut i = 0;
    while !is_same(TOPICS[i], topic) {
        i += 1;
    }
    i
}

/// The messages themselves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Whole;

impl Family for Whole {
    type Of<M: Topic> = M;
}

/// The messages that have come so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Received;

impl Family for Received {
    type Of<M: Topic> = Option<M>;
}

/// References to messages, where there are some.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lent<'a>(PhantomData<&'a ()>);

impl<'a> Family for Lent<'a> {
    type Of<M: Topic> = Option<&'a M>;
}

/// Hash over the layouts of all messages. A reader requires it of a writer before it opens a topic.
#[must_use]
pub fn wire_hash() -> u64 {
    let layouts = MessageLayout::all();
    let hashes = layouts.iter().map(|layout| layout.hash);
    hashes.fold(0, |hash: u64, layout| hash.rotate_left(7) ^ layout)
}
