//! Messages: plain bytes with a name, a layout and a tick.

use bytemuck::{Pod, Zeroable};

/// The hops of the control chain, in the order data flows: the index of each process in [`Stamps`].
pub const HOPS: [&str; 4] = ["plant", "estimator", "analyzer", "controller"];

/// When each hop before this message received its input and sent its output.
///
/// `CLOCK_MONOTONIC` in ns, 0 where the data has not passed. Stamps are for measuring only: no computation reads them,
/// and the content hash leaves them out, because wall-clock time is not reproducible.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Stamps {
    /// When hop `HOPS[i]` had its input in hand.
    pub received_ns: [u64; 4],
    /// When hop `HOPS[i]` sent its output.
    pub sent_ns: [u64; 4],
    /// When the tick should have begun: its point on the real-time grid; 0 in lockstep, where there is none.
    pub due_ns: u64,
}

impl Stamps {
    /// Takes in the stamps of another input of the same tick: of each hop the later ones.
    pub fn merge(&mut self, other: &Self) {
        for hop in 0..HOPS.len() {
            self.received_ns[hop] = self.received_ns[hop].max(other.received_ns[hop]);
            self.sent_ns[hop] = self.sent_ns[hop].max(other.sent_ns[hop]);
        }
        self.due_ns = self.due_ns.max(other.due_ns);
    }

    /// From when on latencies count: from when the tick was due, however late it began; without a grid from when its sample was sent.
    #[must_use]
    #[inline]
    pub fn origin_ns(&self) -> u64 {
        if self.due_ns > 0 { self.due_ns } else { self.sent_ns[0] }
    }
}

/// The first field of every message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Header {
    /// Times of the hops so far; not part of the content.
    pub stamps: Stamps,
    /// Tick of the sensor sample this message was computed from.
    pub tick: u64,
    /// How often the writing process has been started in this run, from 1; a reader refuses an older one.
    pub incarnation: u32,
    /// Bit flags, zero in this version.
    pub flags: u32,
}

/// One field of a message, as data: for layout hashes, for naming a difference, for readers in other languages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// The field's name.
    pub name: &'static str,
    /// Its Rust type, as written.
    pub type_name: &'static str,
    /// Bytes from the start of the message.
    pub offset: usize,
    /// Size in bytes.
    pub size: usize,
}

/// A fixed-size structure with an explicit name: plain integers and `f64`, no padding (`Pod` asserts it at compile time).
pub trait Layout: Part + Pod + Send + Sync + std::fmt::Debug {
    /// The versioned type name that other languages see too: a layout that changes takes the next version (a test holds to that).
    const TYPE_NAME: &'static str;
    /// The layout, in order.
    const FIELDS: &'static [Field];

    /// A hash of name, size, alignment and every field: two builds that agree on it agree on every byte.
    fn layout_hash() -> u64 {
        let mut hash = Fnv::new();
        hash.text(Self::TYPE_NAME);
        hash.number(size_of::<Self>());
        hash.number(align_of::<Self>());
        for field in Self::FIELDS {
            hash.text(field.name);
            hash.text(field.type_name);
            hash.number(field.offset);
            hash.number(field.size);
        }
        Self::hash_parts(&mut hash);
        hash.0
    }
}

/// A message of a topic; its first field is its [`Header`].
pub trait Message: Layout {
    /// The topic it travels on; a topic has one type and one writer.
    const TOPIC: &'static str;

    /// The header.
    fn header(&self) -> &Header;

    /// The header, to be filled by the sender.
    fn header_mut(&mut self) -> &mut Header;

    /// The reproducible bytes: everything after the stamps. This is what is hashed and compared.
    fn content(&self) -> &[u8] {
        &bytemuck::bytes_of(self)[size_of::<Stamps>()..]
    }
}

/// The state that a replacement takes over.
///
/// The process fills it at every tick, the runtime keeps it in the run's shared memory beyond the process's death, and no message carries it.
/// All zeros is no state: the runtime tells a replacement whether there is a checkpoint.
pub trait Checkpoint: Layout {}

/// Anything a message is made of: numbers, arrays of them, structures of those.
pub trait Part {
    /// Whether every `f64` inside is finite: the check at the edge that keeps a NaN from leaving a process.
    fn is_finite(&self) -> bool;
    /// Adds what the field's written type does not tell (the inside of nested structures) to a layout hash.
    fn hash_parts(_hash: &mut Fnv) {}
}

impl Part for f64 {
    fn is_finite(&self) -> bool {
        f64::is_finite(*self)
    }
}
impl Part for u32 {
    fn is_finite(&self) -> bool {
        true
    }
}
impl Part for u64 {
    fn is_finite(&self) -> bool {
        true
    }
}
impl Part for Header {
    fn is_finite(&self) -> bool {
        true
    }
    fn hash_parts(hash: &mut Fnv) {
        let stamps = [("received_ns", "[u64; 4]"), ("sent_ns", "[u64; 4]"), ("due_ns", "u64")];
        for (name, type_name) in stamps.into_iter().chain([("tick", "u64"), ("incarnation", "u32"), ("flags", "u32")]) {
            hash.text(name);
            hash.text(type_name);
        }
    }
}
const _: () = assert!(std::mem::offset_of!(Header, tick) == 72 && std::mem::offset_of!(Header, flags) == 84 && size_of::<Header>() == 88);
impl<T: Part, const N: usize> Part for [T; N] {
    fn is_finite(&self) -> bool {
        // Without an early exit, so that the compiler makes vectors of it: this runs for every message.
        self.iter().fold(true, |finite, part| finite & part.is_finite())
    }
    fn hash_parts(hash: &mut Fnv) {
        T::hash_parts(hash);
    }
}

/// FNV-1a, 64 bit: enough to tell two layouts apart, and short enough to be written in any language.
pub struct Fnv(u64);

impl Fnv {
    const fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
    pub(crate) fn text(&mut self, text: &str) {
        for byte in text.bytes().chain([0]) {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    fn number(&mut self, number: usize) {
        for byte in (number as u64).to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

/// Declares a wire structure: with a topic it is a [`Message`] whose first field is its [`Header`], with the word `checkpoint` a [`Checkpoint`],
/// else a part of one.
macro_rules! wire {
    (
        $(#[$meta:meta])*
        $name:ident $(on $topic:literal version $version:literal)? $(checkpoint version $checkpoint:literal)? {
            $( $(#[$field_meta:meta])* $field:ident : $type:ty ),* $(,)?
        }
    ) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name { $( $(#[$field_meta])* pub $field: $type ),* }

        impl Default for $name {
            fn default() -> Self { bytemuck::Zeroable::zeroed() }
        }

        impl $name {
            /// The layout, in order.
            pub const LAYOUT: &'static [$crate::wire::Field] = &[
                $( $crate::wire::Field {
                    name: stringify!($field),
                    type_name: stringify!($type),
                    offset: std::mem::offset_of!($name, $field),
                    size: $crate::wire::size_of_field(|whole: &$name| &whole.$field),
                } ),*
            ];
        }

        impl $crate::wire::Part for $name {
            #[inline]
            fn is_finite(&self) -> bool { true $( & $crate::wire::Part::is_finite(&self.$field) )* }
            fn hash_parts(hash: &mut $crate::wire::Fnv) {
                $( hash.text(stringify!($field)); hash.text(stringify!($type)); <$type as $crate::wire::Part>::hash_parts(hash); )*
            }
        }

        $( impl $crate::wire::Layout for $name {
            const TYPE_NAME: &'static str = concat!("armplane.", stringify!($name), ".v", $version);
            const FIELDS: &'static [$crate::wire::Field] = Self::LAYOUT;
        }
        impl $crate::wire::Message for $name {
            const TOPIC: &'static str = $topic;
            #[inline]
            fn header(&self) -> &$crate::wire::Header { &self.header }
            #[inline]
            fn header_mut(&mut self) -> &mut $crate::wire::Header { &mut self.header }
        }
        const _: () = assert!(std::mem::offset_of!($name, header) == 0 && align_of::<$name>() == 8); )?

        $( impl $crate::wire::Layout for $name {
            const TYPE_NAME: &'static str = concat!("armplane.", stringify!($name), ".v", $checkpoint);
            const FIELDS: &'static [$crate::wire::Field] = Self::LAYOUT;
        }
        impl $crate::wire::Checkpoint for $name {}
        const _: () = assert!(align_of::<$name>() == 8); )?
    };
}
pub(crate) use wire;

/// The size of a field, from a projection onto it.
pub(crate) const fn size_of_field<Whole, Part>(_projection: fn(&Whole) -> &Part) -> usize {
    size_of::<Part>()
}
