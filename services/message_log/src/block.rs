//! A block of a message log: messages, packed.
//!
//! ```text
//! block    head ([`crate::head`]) · LZ4 block of: contents · packed planes · plain planes
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

/// Whether a block of messages of so many bytes can have so many of them, so many bytes packed, and so many plain planes.
pub(crate) fn is_possible(messages: usize, packed: usize, plain: usize, message_bytes: usize) -> bool {
    messages <= BLOCK && packed <= most_packed(messages, message_bytes) && plain <= message_bytes
}

/// Bytes of the LZ4 block of so many messages at most.
fn most_packed(messages: usize, message_bytes: usize) -> usize {
    get_maximum_output_size((messages + 1) * message_bytes)
}

/// Gathers messages and packs them into blocks; its buffers are kept, so that nothing is allocated per block.
pub(crate) struct Packer {
    /// 64-bit words of a message.
    words: usize,
    /// Bytes of a block's head, for which room is left.
    head: usize,
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
    pub(crate) fn new(words: usize, head: usize) -> Self {
        Self {
            words,
            head,
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

    /// A block without a message: the room for its head.
    pub(crate) fn end(&mut self) -> (&mut [u8], (usize, usize, usize)) {
        if self.packed.len() < self.head {
            self.packed.resize(self.head, 0);
        }
        (&mut self.packed[..self.head], (0, 0, 0))
    }

    /// A block of what has been gathered, with room for its head, and its messages, bytes of its LZ4 block, and plain planes; the next one begins with
    /// nothing.
    pub(crate) fn pack(&mut self) -> (&mut [u8], (usize, usize, usize)) {
        let (n, head) = (self.len().min(BLOCK), self.head);
        let Self { words, folded, above, any, planes, plain, distinct, packed, table, .. } = self;
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
        let most = head + get_maximum_output_size(planes.len()) + plain.len();
        if packed.len() < most {
            packed.resize(most, 0);
        }
        // The buffer holds the worst case.
        let size = compress_into_with_table(planes, &mut packed[head..], table).unwrap_or(0);
        packed[head + size..][..plain.len()].copy_from_slice(plain);
        (&mut packed[..head + size + plain.len()], (n, size, plain.len() / n.max(1)))
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

/// The inverse of [`Packer::pack`], of what follows a block's head: `n` rows of as many words, one after the other. The LZ4 block has `lz4` bytes.
///
/// # Errors
/// A sentence, where the bytes are no such block.
pub(crate) fn unpack((n, lz4): (usize, usize), words: usize, packed: &[u8]) -> Result<Vec<u64>, String> {
    let mut unpacked = vec![0; CONTENTS * words + n * words * size_of::<u64>()];
    let (packed, plain) = packed.split_at_checked(lz4).ok_or("a block ends too early")?;
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
            let mut packer = Packer::new(WORDS, 7);
            for begin in [0, 1_000] {
                let rows: Vec<u64> = (begin..begin + n).flat_map(row).collect();
                rows.chunks(WORDS).for_each(|row| packer.add(row));
                let (block, (messages, lz4, plain)) = packer.pack();
                let rest = &block[7..];
                assert!(
                    is_possible(messages, lz4, plain, 8 * WORDS) && lz4 + messages * plain == rest.len(),
                    "{lz4} bytes, {plain} planes"
                );
                assert_eq!(unpack((messages, lz4), WORDS, rest).as_ref(), Ok(&rows), "{n} rows from {begin}");
                assert!(unpack((messages, lz4), WORDS, &rest[..rest.len() - 1]).is_err(), "a byte is missing");
            }
        }
    }

    #[test]
    fn noise_is_left_as_it_is_and_a_twin_takes_no_room() {
        let bytes = |make: fn(u64) -> [u64; 2]| {
            let mut packer = Packer::new(2, 0);
            (0..BLOCK as u64).for_each(|k| packer.add(&make(k)));
            let (block, (.., plain)) = packer.pack();
            (plain, block.len())
        };
        let (one, two) = (bytes(|k| [random(7, k), 0]), bytes(|k| [random(7, k), random(8, k)]));
        assert_eq!((one.0, two.0), (8, 16), "all eight bytes of a random word");
        let twins = bytes(|k| [random(7, k), random(7, k)]);
        assert!(twins.0 == 8 && twins.1 <= one.1 + 4, "{twins:?} beside {one:?}");
        assert_eq!(bytes(|k| [k, 3 * k]).0, 0, "numbers that change evenly pack");
    }
}
