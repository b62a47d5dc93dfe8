//! Messages: plain bytes with a name, a layout and a tick.

use std::borrow::Cow;

use bytemuck::{Pod, Zeroable};

/// Most processes that have a place in [`Stamps`]; the graph says which process has which: [`Graph::hops`](crate::graph::Graph::hops).
pub const MAX_HOPS: usize = 8;

/// When each hop before this message received its input and sent its output.
///
/// `CLOCK_MONOTONIC` in ns, 0 if the data has not passed. Stamps are for measuring only: no computation reads them,
/// and the content hash leaves them out, because wall-clock time is not reproducible.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Stamps {
    /// When hop i had its input in hand; hop 0 is the process that makes the ticks.
    pub received_ns: [u64; MAX_HOPS],
    /// When hop i sent its output.
    pub sent_ns: [u64; MAX_HOPS],
    /// When the tick should have begun: its point on the real-time grid; 0 in lockstep, where there is none.
    pub due_ns: u64,
}

impl Stamps {
    /// Takes in the stamps of another input of the same tick: of each hop the later ones.
    pub fn merge(&mut self, other: &Self) {
        for hop in 0..MAX_HOPS {
            self.received_ns[hop] = self.received_ns[hop].max(other.received_ns[hop]);
            self.sent_ns[hop] = self.sent_ns[hop].max(other.sent_ns[hop]);
        }
        self.due_ns = self.due_ns.max(other.due_ns);
    }

    /// From when on latencies count: from when the tick was due, however late it began; without a grid from when its sample was sent.
    #[must_use]
    #[inline]
    pub fn origin_ns(&self) -> u64 {
        if self.due_ns > 0 {
            self.due_ns
        } else {
            self.sent_ns[0]
        }
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
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Field {
    /// The field's name.
    pub name: Cow<'static, str>,
    /// Its Rust type, as written.
    pub type_name: Cow<'static, str>,
    /// The type of its elements: `f64`, `u64`, `u32`, `Header`, or the name of another structure.
    pub element: Cow<'static, str>,
    /// Bytes from the start of the message.
    pub offset: usize,
    /// Size in bytes.
    pub size: usize,
    /// One sentence, with the unit after its last semicolon.
    pub about: Cow<'static, str>,
}

impl Field {
    /// A field that is known when the program is compiled.
    #[must_use]
    pub const fn known(
        name: &'static str,
        [type_name, element]: [&'static str; 2],
        offset: usize,
        size: usize,
        about: &'static str,
    ) -> Self {
        Self {
            name: Cow::Borrowed(name),
            type_name: Cow::Borrowed(type_name),
            element: Cow::Borrowed(element),
            offset,
            size,
            about: Cow::Borrowed(about.trim_ascii()),
        }
    }

    /// Whether it is a floating-point number, or an array of them.
    #[must_use]
    pub fn is_number(&self) -> bool {
        self.element == "f64"
    }
}

/// A fixed-size structure with an explicit name: plain integers and `f64`, no padding (`Pod` asserts it at compile time).
pub trait Layout: Part + Pod + Send + Sync + std::fmt::Debug {
    /// The versioned type name that other languages see too: a layout that changes takes the next version (a test holds to that).
    const TYPE_NAME: &'static str;

    /// A hash of name, size, alignment and every field: two builds that agree on it agree on every byte.
    fn layout_hash() -> u64 {
        let mut hash = Fnv::of(
            Self::TYPE_NAME,
            size_of::<Self>(),
            align_of::<Self>(),
            Self::FIELDS,
        );
        Self::hash_parts(&mut hash);
        hash.value()
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
}

/// Anything a message is made of: numbers, arrays of them, structures of those.
pub trait Part {
    /// The type of its elements.
    const ELEMENT: &'static str;
    /// The fields of a structure, in order.
    const FIELDS: &'static [Field] = &[];
    /// A sentence or two on a structure.
    const ABOUT: &'static str = "";
    /// Whether every `f64` inside is finite: the check at the edge that keeps a NaN from leaving a process.
    #[inline]
    fn is_finite(&self) -> bool {
        true
    }
    /// Adds what the field's written type does not tell (the inside of nested structures) to a layout hash.
    fn hash_parts(_hash: &mut Fnv) {}
}

// Inlined by attribute: an incremental build inlines nothing across crates unasked, and each number would be a call.
impl Part for f64 {
    const ELEMENT: &'static str = "f64";
    #[inline]
    fn is_finite(&self) -> bool {
        f64::is_finite(*self)
    }
}
impl Part for u32 {
    const ELEMENT: &'static str = "u32";
}
impl Part for u8 {
    const ELEMENT: &'static str = "u8";
}
impl Part for u64 {
    const ELEMENT: &'static str = "u64";
}
impl Part for Header {
    const ELEMENT: &'static str = "Header";
    /// The stamps looked into.
    const FIELDS: &'static [Field] = &[
        Field::known(
            "received_ns",
            ["[u64; MAX_HOPS]", "u64"],
            0,
            64,
            "When hop i had its input in hand; ns on CLOCK_MONOTONIC",
        ),
        Field::known(
            "sent_ns",
            ["[u64; MAX_HOPS]", "u64"],
            64,
            64,
            "When hop i sent its output; ns on CLOCK_MONOTONIC",
        ),
        Field::known(
            "due_ns",
            ["u64", "u64"],
            128,
            8,
            "When the tick should have begun, 0 in lockstep; ns on CLOCK_MONOTONIC",
        ),
        Field::known(
            "tick",
            ["u64", "u64"],
            136,
            8,
            "Tick of the sensor sample this message was computed from",
        ),
        Field::known(
            "incarnation",
            ["u32", "u32"],
            144,
            4,
            "How often the writing process has been started in this run, from 1",
        ),
        Field::known(
            "flags",
            ["u32", "u32"],
            148,
            4,
            "Bit flags, zero in this version",
        ),
    ];
    fn hash_parts(hash: &mut Fnv) {
        for Field {
            name,
            element,
            size,
            ..
        } in Self::FIELDS
        {
            hash.text(name);
            hash.text(element);
            hash.number(*size);
        }
    }
}

const _: () = assert!(
    std::mem::offset_of!(Header, tick) == 136
        && std::mem::offset_of!(Header, flags) == 148
        && size_of::<Header>() == 152
);

impl<T: Part, const N: usize> Part for [T; N] {
    const ELEMENT: &'static str = T::ELEMENT;
    #[inline]
    fn is_finite(&self) -> bool {
        // Without an early exit, so that the compiler makes vectors of it: this runs for every message.
        self.iter()
            .fold(true, |finite, part| finite & part.is_finite())
    }
    fn hash_parts(hash: &mut Fnv) {
        T::hash_parts(hash);
    }
}

/// FNV-1a, 64 bit: enough to tell two layouts apart, and short enough to be written in any language.
pub struct Fnv(u64);

impl Fnv {
    /// The hash of a layout as far as its fields tell; nested structures are still to be added.
    pub(crate) fn of(type_name: &str, size: usize, align: usize, fields: &[Field]) -> Self {
        let mut hash = Self(0xcbf2_9ce4_8422_2325);
        hash.text(type_name);
        hash.number(size);
        hash.number(align);
        for field in fields {
            hash.text(&field.name);
            hash.text(&field.element);
            hash.number(field.offset);
            hash.number(field.size);
        }
        hash
    }

    pub(crate) fn value(&self) -> u64 {
        self.0
    }

    /// Adds a name.
    pub fn text(&mut self, text: &str) {
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

/// Declares a wire structure: with a topic it is a [`Message`] whose first field is its [`Header`], with the word `checkpoint` the state that a
/// replacement takes over, without a version a part of one. All zeros is no state: the runtime tells a replacement whether there is one.
///
/// Crates that define messages of their own need `bytemuck` (feature `derive`) among their dependencies:
///
/// ```
/// use shared_types::wire::{Header, Message, wire};
///
/// wire! {
///     /// The battery of the arm's cart.
///     Battery on "battery" version 1 {
///         /// Tick, incarnation, stamps.
///         header: Header,
///         /// Voltage of each cell; V.
///         cells: [f64; 4],
///     }
/// }
/// assert_eq!((Battery::TOPIC, size_of::<Battery>()), ("battery", size_of::<Header>() + 32));
/// ```
#[macro_export]
macro_rules! wire {
    (
        $( #[doc = $about:literal] )*
        $name:ident $(on $topic:literal)? $(checkpoint)? $(version $version:literal)? {
            $( $( #[doc = $doc:literal] )* $field:ident : $type:ty ),* $(,)?
        }
    ) => {
        $( #[doc = $about] )*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        #[allow(unreachable_pub, reason = "a message of a program's own may stand in a private module")]
        pub struct $name { $( $( #[doc = $doc] )* pub $field: $type ),* }

        impl Default for $name {
            fn default() -> Self { bytemuck::Zeroable::zeroed() }
        }

        impl $crate::wire::Part for $name {
            const ELEMENT: &'static str = stringify!($name);
            const FIELDS: &'static [$crate::wire::Field] = &[
                $( $crate::wire::Field::known(
                    stringify!($field),
                    [stringify!($type), <$type as $crate::wire::Part>::ELEMENT],
                    std::mem::offset_of!($name, $field),
                    size_of::<$type>(),
                    concat!($( $doc ),*),
                ) ),*
            ];
            const ABOUT: &'static str = concat!($( $about ),*).trim_ascii();
            #[inline]
            fn is_finite(&self) -> bool { true $( & $crate::wire::Part::is_finite(&self.$field) )* }
            fn hash_parts(hash: &mut $crate::wire::Fnv) {
                $(
                    hash.text(stringify!($field));
                    hash.text(<$type as $crate::wire::Part>::ELEMENT);
                    <$type as $crate::wire::Part>::hash_parts(hash);
                )*
            }
        }

        $( impl $crate::wire::Layout for $name {
            const TYPE_NAME: &'static str = concat!("armplane.", stringify!($name), ".v", $version);
        }
        const _: () = assert!(align_of::<$name>() == 8); )?

        $( impl $crate::wire::Message for $name {
            const TOPIC: &'static str = $topic;
            #[inline]
            fn header(&self) -> &$crate::wire::Header { &self.header }
            #[inline]
            fn header_mut(&mut self) -> &mut $crate::wire::Header { &mut self.header }
        }
        const _: () = assert!(std::mem::offset_of!($name, header) == 0); )?
    };
}
pub use wire;
