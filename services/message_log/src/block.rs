//! A block of a message log: messages, packed.
//!
//! ```text
//! block    messages n u32 · bytes of the LZ4 block u32 · plain planes u32 · CRC-32 u32 of all else in the block
//!          · LZ4 block of: contents · packed planes · plain planes
//! contents for each word which planes there are u8 · for each word which of them are plain u8 · for each word its twin u16
//! ```
//!
//! All integers little-endian. A message is a row of 64-bit words, each word minus the one above it (the first row minus nothing), zig-zagged so
//! that small changes of either sign are small numbers. A plane is one byte of one word of all messages: of the first word the lowest bytes, its
//! second bytes, … then those of the second word. Planes of zeros, most of them, are left out: in the contents each word has a bit for each of
//! its eight planes that follows. Planes of noise, the low bytes of numbers, stay as they are: LZ4 would look through them in vain. A word that
//! is the same as an earlier one in all messages has no planes, and as its twin 1 + the place of that one, else 0.

use lz4_flex::block::{CompressTable, compress_into_with_table, decompress_into, get_maximum_output_size};

/// Messages in a block: what a killed writer takes with it. Its replacement finds them in the retainer of the topic, which holds far more.
pub const BLOCK: usize = 128;
/// Bytes of a block's contents for each word.
const CONTENTS: usize = 4;
/// How many distinct words back a twin is looked for: a frame repeats its axes, not another message's.
const TWIN_REACH: usize = 64;

/// The numbers at the beginning of a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Head {
    pub(crate) messages: usize,
    /// Bytes of the LZ4 block.
    pub(crate) packed: usize,
    /// Planes behind it.
    pub(crate) plain: usize,
    /// CRC-32 of these three numbers and of what follows the head.
    checksum: u32,
}

impl Head {
    pub(crate) const BYTES: usize = 16;
    /// Those of them that the checksum covers; the checksum follows.
    const CHECKED: usize = 12;

    /// Whether a block of messages of so many bytes can have it.
    pub(crate) fn is_possible(self, message_bytes: usize) -> bool {
        (1..=BLOCK).contains(&self.messages) && self.packed <= most_packed(self.messages, message_bytes) && self.plain <= message_bytes
    }

    /// Whether a block, which begins with it, is as it was written.
    pub(crate) fn has_checksum_of(self, block: &[u8]) -> bool {
        checksum(block) == self.checksum
    }

    /// Bytes of the block behind it.
    pub(crate) fn rest(self) -> usize {
        self.packed + self.messages * self.plain
    }
}

impl From<[u8; Head::BYTES]> for Head {
    fn from(bytes: [u8; Self::BYTES]) -> Self {
        let number = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]) as usize;
        Self { messages: number(0), packed: number(4), plain: number(8), checksum: number(12) as u32 }
    }
}

/// Bytes of the LZ4 block of so many messages at most.
fn most_packed(messages: usize, message_bytes: usize) -> usize {
    get_maximum_output_size((messages + 1) * message_bytes)
}

/// Bytes of a block at most.
pub(crate) fn longest(message_bytes: usize) -> usize {
    Head::BYTES + most_packed(BLOCK, message_bytes) + BLOCK * message_bytes
}

/// Whether bytes begin with a block of messages of so many bytes, as it was written.
pub(crate) fn begins_whole(bytes: &[u8], message_bytes: usize) -> bool {
    let Some(head) = bytes.first_chunk().map(|head| Head::from(*head)) else { return false };
    let block = head.is_possible(message_bytes).then(|| bytes.get(..Head::BYTES + head.rest())).flatten();
    block.is_some_and(|block| head.has_checksum_of(block))
}

/// The CRC-32 of a block but for the checksum itself.
fn checksum(block: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&block[..Head::CHECKED]);
    hasher.update(&block[Head::BYTES..]);
    hasher.finalize()
}

/// Gives a block, its head complete but for the checksum, the checksum of what it holds.
pub(crate) fn seal(block: &mut [u8]) {
    let sum = checksum(block);
    block[Head::CHECKED..Head::BYTES].copy_from_slice(&sum.to_le_bytes());
}

/// Gathers messages and packs them into blocks; its buffers are kept, so that nothing is allocated per block.
pub(crate) struct Packer {
    /// 64-bit words of a message.
    words: usize,
    /// Differences of each word of each gathered message from the one above it, zig-zagged; row by row.
    folded: Vec<u64>,
    /// The last message.
    above: Vec<u64>,
    /// All bits that any difference of a word has.
    any: Vec<u64>,
    /// Contents and planes that LZ4 packs.
    planes: Vec<u8>,
    /// Planes that it does not.
    plain: Vec<u8>,
    /// Distinct words of the block so far: all bits of each, its first value, its place.
    distinct: Vec<(u64, u64, usize)>,
    /// The block, as it is written.
    packed: Vec<u8>,
    table: CompressTable,
}

impl Packer {
    pub(crate) fn new(words: usize) -> Self {
        Self {
            words,
            folded: Vec::with_capacity(BLOCK * words),
            above: vec![0; words],
            any: vec![0; words],
            planes: Vec::new(),
            plain: Vec::new(),
            distinct: Vec::new(),
            packed: Vec::new(),
            table: CompressTable::large(),
        }
    }

    /// Messages gathered.
    pub(crate) fn len(&self) -> usize {
        self.folded.len() / self.words
    }

    /// Takes a message in while it is in the cache: one pass over its words.
    pub(crate) fn add(&mut self, row: &[u64]) {
        self.folded.extend(row.iter().zip(&mut self.above).zip(&mut self.any).map(|((value, above), any)| {
            let delta = value.wrapping_sub(*above).cast_signed();
            let folded = ((delta << 1) ^ (delta >> 63)).cast_unsigned();
            *above = *value;
            *any |= folded;
            folded
        }));
    }

    /// A block of what has been gathered; the next one begins with nothing.
    pub(crate) fn pack(&mut self) -> &[u8] {
        let n = self.len().min(BLOCK);
        let Self { words, folded, above, any, planes, plain, distinct, packed, table } = self;
        let words = *words;
        planes.clear();
        planes.resize(CONTENTS * words, 0);
        plain.clear();
        distinct.clear();
        let mut column = [0_u64; BLOCK];
        let mut bytes = [[0_u8; BLOCK]; size_of::<u64>()];
        for (word, any) in any.iter().enumerate().filter(|(_, any)| **any != 0) {
            column.iter_mut().zip(folded[word..].iter().step_by(words)).for_each(|(to, from)| *to = *from);
            let is_twin = |other: usize| column[..n].iter().zip(folded[other..].iter().step_by(words)).all(|(one, other)| one == other);
            let near = distinct.iter().rev().take(TWIN_REACH);
            let alike = near.filter(|(bits, first, _)| bits == any && *first == column[0]).map(|(.., other)| *other);
            if let Some(twin) = alike.into_iter().find(|other| is_twin(*other))
                && let Ok(twin) = u16::try_from(twin + 1)
            {
                planes[2 * words + 2 * word..][..2].copy_from_slice(&twin.to_le_bytes());
                continue;
            }
            distinct.push((*any, column[0], word));
            for (group, rows) in column.as_chunks::<8>().0.iter().enumerate() {
                for (plane, eight) in bytes.iter_mut().zip(transposed(*rows)) {
                    plane[8 * group..][..8].copy_from_slice(&eight.to_le_bytes());
                }
            }
            for (byte, plane) in bytes.iter().enumerate().filter(|(byte, _)| any >> (8 * byte) & 0xff != 0) {
                planes[word] |= 1 << byte;
                if is_noise(&plane[..n]) {
                    planes[words + word] |= 1 << byte;
                    plain.extend_from_slice(&plane[..n]);
                } else {
                    planes.extend_from_slice(&plane[..n]);
                }
            }
        }
        folded.clear();
        above.fill(0);
        any.fill(0);
        let most = Head::BYTES + get_maximum_output_size(planes.len()) + plain.len();
        if packed.len() < most {
            packed.resize(most, 0);
        }
        // The buffer holds the worst case.
        let size = compress_into_with_table(planes, &mut packed[Head::BYTES..], table).unwrap_or(0);
        packed[Head::BYTES + size..][..plain.len()].copy_from_slice(plain);
        for (to, number) in packed.as_chunks_mut::<4>().0.iter_mut().zip([n, size, plain.len() / n.max(1)]) {
            *to = (number as u32).to_le_bytes();
        }
        let block = &mut packed[..Head::BYTES + size + plain.len()];
        seal(block);
        block
    }
}

/// Whether so few neighbours in a plane are equal, an eighth, that it does not pack. Of random bytes 1 in 256 are.
fn is_noise(plane: &[u8]) -> bool {
    let Some((_, next)) = plane.split_first() else { return false };
    // At most 127 pairs.
    let equal: u8 = plane.iter().zip(next).map(|(one, next)| u8::from(one == next)).sum();
    8 * usize::from(equal) < plane.len()
}

/// Eight words as a square of bytes, its rows as columns: word *b* holds byte *b* of each. Halves, quarters and eighths are swapped in turn.
fn transposed(mut words: [u64; 8]) -> [u64; 8] {
    for (step, mask) in [(4, 0x0000_0000_ffff_ffff_u64), (2, 0x0000_ffff_0000_ffff), (1, 0x00ff_00ff_00ff_00ff)] {
        for i in (0..8).filter(|i| i & step == 0) {
            let swapped = (words[i] >> (8 * step) ^ words[i + step]) & mask;
            words[i + step] ^= swapped;
            words[i] ^= swapped << (8 * step);
        }
    }
    words
}

/// The inverse of [`Packer::pack`], of what follows a block's head: rows of as many words, one after the other.
///
/// # Errors
/// A sentence, where the bytes are no such block.
pub(crate) fn unpack(head: Head, words: usize, packed: &[u8]) -> Result<Vec<u64>, String> {
    let n = head.messages;
    let mut unpacked = vec![0; CONTENTS * words + n * words * size_of::<u64>()];
    let (packed, plain) = packed.split_at_checked(head.packed).ok_or("a block ends too early")?;
    let size = decompress_into(packed, &mut unpacked).map_err(|error| error.to_string())?;
    let (contents, planes) = unpacked.split_at(CONTENTS * words);
    let ((present, as_they_are), twins) = (contents[..2 * words].split_at(words), contents[2 * words..].as_chunks::<2>().0);
    let count = |bytes: &[u8]| bytes.iter().map(|byte| byte.count_ones() as usize).sum::<usize>();
    let (all, plain_ones) = (count(present), count(as_they_are));
    if present.iter().zip(as_they_are).any(|(present, plain)| plain & !present != 0) {
        return Err("a block has plain planes that are not there".to_owned());
    }
    let expected = CONTENTS * words + n * (all - plain_ones);
    if size != expected || plain.len() != n * plain_ones {
        let found = size + plain.len();
        return Err(format!("a block of {n} messages unpacks to {found} bytes and not to {}", expected + n * plain_ones));
    }
    let mut rows = vec![0_u64; n * words];
    let (mut planes, mut plain) = (planes.chunks_exact(n), plain.chunks_exact(n));
    for word in 0..words {
        let twin = usize::from(u16::from_le_bytes(twins[word]));
        if twin > word {
            return Err(format!("word {word} of a block is the twin of a later one"));
        }
        if twin > 0 {
            rows.chunks_exact_mut(words).for_each(|row| row[word] = row[twin - 1]);
            continue;
        }
        for byte in (0..8).filter(|byte| present[word] & 1 << byte != 0) {
            let plane = if as_they_are[word] & 1 << byte != 0 { plain.next() } else { planes.next() };
            for (row, part) in rows.chunks_exact_mut(words).zip(plane.unwrap_or_default()) {
                row[word] |= u64::from(*part) << (8 * byte);
            }
        }
        let mut above = 0_u64;
        for row in rows.chunks_exact_mut(words) {
            let folded = row[word];
            above = above.wrapping_add((folded >> 1) ^ (folded & 1).wrapping_neg());
            row[word] = above;
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::random::at as random;

    const WORDS: usize = 9;

    /// Words that count, stand still, are noise, and repeat another word.
    fn row(k: u64) -> [u64; WORDS] {
        let (count, noise) = (1_000_000 * k + k % 7, random(7, k));
        [count, 0, 5, noise, noise >> 40, noise, count, u64::MAX - k, f64::to_bits(0.1 * k as f64)]
    }

    #[test]
    fn every_word_comes_back_from_a_block_of_any_length() {
        for n in [1, 2, 7, 64, BLOCK as u64] {
            let mut packer = Packer::new(WORDS);
            for begin in [0, 1_000] {
                let rows: Vec<u64> = (begin..begin + n).flat_map(row).collect();
                rows.chunks(WORDS).for_each(|row| packer.add(row));
                let block = packer.pack().to_vec();
                let (head, rest) = block.split_first_chunk::<{ Head::BYTES }>().expect("a head");
                let head = Head::from(*head);
                assert!(head.is_possible(8 * WORDS) && head.rest() == rest.len() && head.has_checksum_of(&block), "{head:?}");
                assert_eq!(unpack(head, WORDS, rest).as_ref(), Ok(&rows), "{n} rows from {begin}");
                assert!(unpack(head, WORDS, &rest[..rest.len() - 1]).is_err(), "a byte is missing");
            }
        }
    }

    #[test]
    fn noise_is_left_as_it_is_and_a_twin_takes_no_room() {
        let bytes = |make: fn(u64) -> [u64; 2]| {
            let mut packer = Packer::new(2);
            (0..BLOCK as u64).for_each(|k| packer.add(&make(k)));
            let block = packer.pack();
            let plain = Head::from(*block.first_chunk().expect("a head")).plain;
            (plain, block.len())
        };
        let (one, two) = (bytes(|k| [random(7, k), 0]), bytes(|k| [random(7, k), random(8, k)]));
        assert_eq!((one.0, two.0), (8, 16), "all eight bytes of a random word");
        let twins = bytes(|k| [random(7, k), random(7, k)]);
        assert!(twins.0 == 8 && twins.1 <= one.1 + 4, "{twins:?} beside {one:?}");
        assert_eq!(bytes(|k| [k, 3 * k]).0, 0, "numbers that change evenly pack");
    }
}
