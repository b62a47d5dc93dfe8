//! A block of a message log: messages, packed.
//!
//! ```text
//! block    head ([`crate::head`]) · LZ4 block of: contents · first message · packed planes · plain planes
//! contents for each word which planes there are u8 · for each word which of them are plain u8 · for each word its twin u16
//! ```
//!
//! All integers little-endian. A message is a row of 64-bit words. The first one stands as it is; of the others each word minus the one above it, zig-zagged
//! so that small changes of either sign are small numbers. A plane is one byte of one word of all messages but the first: of the first word the lowest bytes,
//! its second bytes, … then those of the second word. Planes of zeros, most of them, are left out: in the contents each word has a bit for each of
//! its eight planes that follows. Planes of noise, the low bytes of numbers, stay as they are: LZ4 would look through them in vain. A word that
//! is the same as an earlier one in all messages has no planes, and as its twin 1 + the place of that one, else 0.

use lz4_flex::block::{CompressTable, compress_into_with_table, decompress_into, get_maximum_output_size};

/// Messages in a block: what a killed writer takes with it. Its replacement finds them in the retainer of the topic, which holds far more.
pub const BLOCK: usize = 128;
/// Bytes of a block's contents for each word.
const CONTENTS: usize = 4;
/// Places of words that a twin is looked for among, by the ends of their columns: more than a message has different words.
const TWINS: usize = 512;
/// Words that are gathered together: they are on one line of the cache, or two.
const LINE: usize = 8;
/// Messages that are taken apart together: two words fill a register, so that a square of bytes has as many rows as a register has.
const SQUARE: usize = 16;

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
    /// The gathered messages; row by row.
    rows: Vec<u64>,
    /// All bits in which a word of any of them differs from the first one's.
    varying: Vec<u64>,
    /// Contents and planes that LZ4 packs.
    planes: Vec<u8>,
    /// Planes that it does not.
    plain: Vec<u8>,
    /// For the ends of a column, 1 + the place of the last word of the block with such a column; else 0.
    twins: [u16; TWINS],
    /// The block, as it is written.
    packed: Vec<u8>,
    table: CompressTable,
}

impl Packer {
    pub(crate) fn new(words: usize, head: usize) -> Self {
        Self {
            words,
            head,
            rows: Vec::with_capacity(BLOCK * words),
            varying: vec![0; words],
            planes: Vec::new(),
            plain: Vec::new(),
            twins: [0; TWINS],
            packed: Vec::new(),
            table: CompressTable::large(),
        }
    }

    /// Messages gathered.
    pub(crate) fn len(&self) -> usize {
        self.rows.len() / self.words
    }

    /// Takes a message in.
    pub(crate) fn add(&mut self, row: &[u64]) {
        self.rows.extend_from_slice(row);
        let first = &self.rows[..row.len()];
        self.varying.iter_mut().zip(first).zip(row).for_each(|((varying, first), value)| *varying |= first ^ value);
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
        let Self { words, rows, varying, planes, plain, twins, packed, table, .. } = self;
        let words = *words;
        let steps = n.saturating_sub(1);
        planes.clear();
        plain.clear();
        take_apart(&Block { words, n, rows, varying }, planes, plain, twins);
        rows.clear();
        varying.fill(0);
        let most = head + get_maximum_output_size(planes.len()) + plain.len();
        if packed.len() < most {
            packed.resize(most, 0);
        }
        // The buffer holds the worst case.
        let size = compress_into_with_table(planes, &mut packed[head..], table).unwrap_or(0);
        packed[head + size..][..plain.len()].copy_from_slice(plain);
        (&mut packed[..head + size + plain.len()], (n, size, plain.len() / steps.max(1)))
    }
}

/// The content that a block is made from.
struct Block<'a> {
    words: usize,
    n: usize,
    rows: &'a [u64],
    varying: &'a [u64],
}

/// Contents, first message and planes of a block, with the widest instructions that the processor has: the same bytes with all of them.
fn take_apart(block: &Block<'_>, planes: &mut Vec<u8>, plain: &mut Vec<u8>, twins: &mut [u16; TWINS]) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2(block: &Block<'_>, planes: &mut Vec<u8>, plain: &mut Vec<u8>, twins: &mut [u16; TWINS]) {
            take_apart_with(block, planes, plain, twins);
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has these instructions.
            return unsafe { with_avx2(block, planes, plain, twins) };
        }
    }
    take_apart_with(block, planes, plain, twins);
}

#[inline(always)]
fn take_apart_with(&Block { words, n, rows, varying }: &Block<'_>, planes: &mut Vec<u8>, plain: &mut Vec<u8>, twins: &mut [u16; TWINS]) {
    let steps = n.saturating_sub(1);
    planes.resize(CONTENTS * words, 0);
    planes.extend_from_slice(bytemuck::cast_slice(rows.get(..words).unwrap_or_default()));
    twins.fill(0);
    let (mut columns, mut gathered, mut bytes) = ([[0; BLOCK + 1]; LINE], None, [0_u8; PLANES]);
    for word in (0..words).filter(|word| varying[*word] != 0) {
        let (first, last) = (rows[word], rows[steps * words + word]);
        let known = &mut twins[ends_of(first, last)];
        let is_twin = |other: usize| varying[other] == varying[word] && rows.chunks_exact(words).all(|row| row[other] == row[word]);
        if *known > 0 && is_twin(usize::from(*known) - 1) {
            planes[2 * words + 2 * word..][..2].copy_from_slice(&known.to_le_bytes());
            continue;
        }
        *known = u16::try_from(word + 1).unwrap_or(0);
        let (line, column) = (word / LINE, word % LINE);
        if gathered != Some(line) {
            gather(rows, words, line * LINE, &mut columns);
            gathered = Some(line);
        }
        let column = &mut columns[column];
        // A block that is not full has nothing new behind its end.
        column[n..].fill(last);
        let any = fold(column);
        apart(column, &mut bytes);
        for byte in (0..size_of::<u64>()).filter(|byte| any >> (8 * byte) & 0xff != 0) {
            planes[word] |= 1 << byte;
            let is_noise = is_noise(&bytes, byte, steps);
            planes[words + word] |= u8::from(is_noise) << byte;
            // Whole ones, of a length that is known here, and then what is too much of them away.
            let to = if is_noise { &mut *plain } else { &mut *planes };
            to.extend_from_slice(&bytes.as_chunks::<BLOCK>().0[byte]);
            to.truncate(to.len() - (BLOCK - steps));
        }
    }
}

/// The columns of the words from `begin` on.
#[inline(always)]
fn gather(rows: &[u64], words: usize, begin: usize, columns: &mut [Column; LINE]) {
    let mut rows = rows.chunks_exact(words);
    for k in 0..BLOCK {
        let Some(row) = rows.next() else { break };
        match row[begin..].first_chunk::<LINE>() {
            Some(line) => columns.iter_mut().zip(line).for_each(|(column, value)| column[k] = *value),
            None => columns.iter_mut().zip(&row[begin..]).for_each(|(column, value)| column[k] = *value),
        }
    }
}

/// The place of a column among the [`TWINS`] by its first and last number.
fn ends_of(first: u64, last: u64) -> usize {
    // Fibonacci hashing: Knuth, The Art of Computer Programming, volume 3, 6.4.
    let mixed = (first ^ last.rotate_left(32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> (u64::BITS - TWINS.ilog2())) as usize
}

/// A number of each message, and at the end one more, the same as the last.
type Column = [u64; BLOCK + 1];

/// Each number of a column but the first minus the one before it, zig-zagged, in the place of that one; returns all bits that any of them has.
#[inline(always)]
fn fold(column: &mut Column) -> u64 {
    (0..BLOCK).fold(0, |any, k| {
        let delta = column[k + 1].wrapping_sub(column[k]).cast_signed();
        column[k] = ((delta << 1) ^ (delta >> 63)).cast_unsigned();
        any | column[k]
    })
}

/// Bytes of the planes of a column, and one more, which ends the last one's neighbours.
const PLANES: usize = BLOCK * size_of::<u64>() + 1;

/// The planes of a column one after the other.
#[inline(always)]
fn apart(column: &Column, bytes: &mut [u8; PLANES]) {
    for (group, rows) in column.as_chunks::<SQUARE>().0.iter().enumerate() {
        for (byte, part) in transposed(rows).as_chunks::<SQUARE>().0.iter().enumerate() {
            bytes[byte * BLOCK + group * SQUARE..][..SQUARE].copy_from_slice(part);
        }
    }
}

/// Sixteen words as their lowest bytes, their second bytes, and so on. The place of a byte is a number of seven bits, four for its word and three for its
/// place in the word. To interleave the halves of all bytes turns these bits by one: four times exchanges words and places.
#[inline(always)]
fn transposed(words: &[u64; SQUARE]) -> [u8; SQUARE * size_of::<u64>()] {
    const HALF: usize = SQUARE * size_of::<u64>() / 2;
    let mut bytes = [0; 2 * HALF];
    for (to, word) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(words) {
        *to = word.to_le_bytes();
    }
    for _ in 0..4 {
        let mut turned = [0; 2 * HALF];
        for k in 0..HALF {
            (turned[2 * k], turned[2 * k + 1]) = (bytes[k], bytes[HALF + k]);
        }
        bytes = turned;
    }
    bytes
}

/// Whether so few neighbours in a plane of so many bytes are equal, an eighth, that it does not pack. Of random bytes 1 in 256 are.
#[inline(always)]
fn is_noise(bytes: &[u8; PLANES], plane: usize, length: usize) -> bool {
    let Some(with_next) = bytes[plane * BLOCK..].first_chunk::<{ BLOCK + 1 }>() else { return false };
    let is_equal = |k: usize| u8::from(with_next[k] == with_next[k + 1]);
    // At most 128 pairs, of which the last ones are none of this plane's: a number that is known here makes one pass of it.
    let all: u8 = (0..BLOCK).map(is_equal).sum();
    let beyond: u8 = (length.max(1) - 1..BLOCK).map(is_equal).sum();
    8 * usize::from(all - beyond) < length
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
    let (first, planes) = planes.split_at((words * size_of::<u64>()).min(planes.len()));
    let steps = n.saturating_sub(1);
    let ((present, as_they_are), twins) = (contents[..2 * words].split_at(words), contents[2 * words..].as_chunks::<2>().0);
    let count = |bytes: &[u8]| bytes.iter().map(|byte| byte.count_ones() as usize).sum::<usize>();
    let (all, plain_ones) = (count(present), count(as_they_are));
    if present.iter().zip(as_they_are).any(|(present, plain)| plain & !present != 0) {
        return Err("a block has plain planes that are not there".to_owned());
    }
    let expected = contents.len() + first.len() + steps * (all - plain_ones);
    if n == 0 || size != expected || plain.len() != steps * plain_ones {
        let found = size + plain.len();
        return Err(format!("a block of {n} messages unpacks to {found} bytes and not to {}", expected + steps * plain_ones));
    }
    let mut rows = vec![0_u64; n * words];
    rows.iter_mut().zip(first.as_chunks::<8>().0).for_each(|(word, bytes)| *word = u64::from_le_bytes(*bytes));
    let (mut planes, mut plain) = (planes.chunks_exact(steps.max(1)), plain.chunks_exact(steps.max(1)));
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
            for (row, part) in rows.chunks_exact_mut(words).skip(1).zip(plane.unwrap_or_default()) {
                row[word] |= u64::from(*part) << (8 * byte);
            }
        }
        let mut above = rows[word];
        for row in rows.chunks_exact_mut(words).skip(1) {
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
                    is_possible(messages, lz4, plain, 8 * WORDS) && lz4 + (messages - 1) * plain == rest.len(),
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
