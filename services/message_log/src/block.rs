//! A block of a message log: messages, packed.
//!
//! ```text
//! block    head ([`crate::head`]) · contents and first message · planes
//! contents for each word: which planes there are u8 · which of them are plain u8 · which are steady u8 · its twin u16
//! ```
//!
//! All integers little-endian. A message is a row of 64-bit words. The first one stands as it is; of the others each word minus the one above it, zig-zagged
//! so that small changes of either sign are small numbers. A plane is one byte of one word of all messages but the first: of the first word the lowest bytes,
//! its second bytes, … then those of the second word. Planes of zeros, most of them, are left out: in the contents each word has a bit for each of
//! its eight planes that follows. A word that is the same as an earlier one in all messages has no planes, and as its twin 1 + the place of that one, else 0.
//!
//! A plane is a mask, a bit for each of its bytes, and the bytes whose bits are set. The others are zero, or in a steady plane the same as the byte before,
//! whichever is shorter; the byte before the first is zero. A plane of noise, which a mask does not make shorter, is plain: its bytes alone. Contents and first
//! message are pieces of [`BLOCK`] bytes with the masks of planes that are not steady.
//!
//! A general packer (LZ4) makes blocks of the same size with more than twice the instructions: what repeats in messages repeats from one to the next.

/// Messages in a block: what a killed writer takes with it. Its replacement finds them in the retainer of the topic, which holds far more.
pub const BLOCK: usize = 128;
/// Bytes of a block's contents for each word.
const CONTENTS: usize = 5;
/// Those and the word of the first message.
const BEGIN: usize = CONTENTS + size_of::<u64>();
/// Places of words that a twin is looked for among, by the ends of their columns: more than a message has different words.
const TWINS: usize = 512;
/// Words that are gathered together: they are on one line of the cache, or two.
const LINE: usize = 8;
/// Messages that are taken apart together: two words fill a register, so that a square of bytes has as many rows as a register has.
const SQUARE: usize = 16;
/// Bytes of the mask of a whole plane.
const MASK: usize = BLOCK / 8;
/// Bytes that a plane may take while it is written, before its length is known.
const ROOM: usize = MASK + BLOCK;

/// Whether a block of messages of so many bytes can have so many of them, and so many bytes packed.
pub(crate) fn is_possible(messages: usize, packed: usize, message_bytes: usize) -> bool {
    messages <= BLOCK && packed <= most_packed(messages, message_bytes / size_of::<u64>())
}

/// Bytes of so many packed messages at most.
fn most_packed(messages: usize, words: usize) -> usize {
    most_of_begin(words) + most_of_planes(messages, words)
}

/// Bytes of packed contents and first message at most.
fn most_of_begin(words: usize) -> usize {
    BEGIN * words + (BEGIN * words).div_ceil(BLOCK) * MASK
}

/// Bytes of planes at most: none is longer than it is plain.
fn most_of_planes(messages: usize, words: usize) -> usize {
    size_of::<u64>() * words * messages.saturating_sub(1)
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
    /// Contents and first message, and the same packed.
    begin: Vec<u8>,
    packed_begin: Vec<u8>,
    /// For the ends of a column, 1 + the place of the last word of the block with such a column; else 0.
    twins: [u16; TWINS],
    /// The block: its planes have a place of their own, and what stands before them ends there.
    block: Vec<u8>,
}

impl Packer {
    pub(crate) fn new(words: usize, head: usize) -> Self {
        let begin = most_of_begin(words);
        Self {
            words,
            head,
            rows: Vec::with_capacity(BLOCK * words),
            varying: vec![0; words],
            begin: vec![0; BEGIN * words],
            packed_begin: vec![0; begin + ROOM],
            twins: [0; TWINS],
            block: vec![0; head + begin + most_of_planes(BLOCK, words) + ROOM],
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
        self.varying
            .iter_mut()
            .zip(first)
            .zip(row)
            .for_each(|((varying, first), value)| *varying |= first ^ value);
    }

    /// A block without a message: the room for its head.
    pub(crate) fn end(&mut self) -> &mut [u8] {
        &mut self.block[..self.head]
    }

    /// A block of what has been gathered, with room for its head, and its messages; the next one begins with nothing.
    pub(crate) fn pack(&mut self) -> (&mut [u8], usize) {
        let n = self.len().min(BLOCK);
        let Self {
            words,
            head,
            rows,
            varying,
            begin,
            packed_begin,
            twins,
            block,
        } = self;
        let planes = *head + most_of_begin(*words);
        begin.fill(0);
        begin[CONTENTS * *words..]
            .copy_from_slice(bytemuck::cast_slice(rows.get(..*words).unwrap_or_default()));
        let size = take_apart(
            &Block {
                words: *words,
                n,
                rows,
                varying,
            },
            begin,
            twins,
            &mut block[planes..],
        );
        let mut before = 0;
        for piece in begin.chunks(BLOCK) {
            let mut plane = [0; BLOCK + 1];
            plane[1..][..piece.len()].copy_from_slice(piece);
            before += put_masked(
                &plane,
                &is_not_zero(&plane),
                piece.len(),
                &mut packed_begin[before..],
            );
        }
        block[planes - before..planes].copy_from_slice(&packed_begin[..before]);
        rows.clear();
        varying.fill(0);
        (&mut block[planes - before - *head..planes + size], n)
    }
}

/// The content that a block is made from.
struct Block<'a> {
    words: usize,
    n: usize,
    rows: &'a [u64],
    varying: &'a [u64],
}

/// The planes of a block, which are entered into its contents, with the widest instructions that the processor has: the same bytes with all of them. Returns
/// how many.
fn take_apart(
    block: &Block<'_>,
    contents: &mut [u8],
    twins: &mut [u16; TWINS],
    out: &mut [u8],
) -> usize {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn with_avx2(
            block: &Block<'_>,
            contents: &mut [u8],
            twins: &mut [u16; TWINS],
            out: &mut [u8],
        ) -> usize {
            take_apart_with(block, contents, twins, out)
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has these instructions.
            return unsafe { with_avx2(block, contents, twins, out) };
        }
    }
    take_apart_with(block, contents, twins, out)
}

#[inline(always)]
fn take_apart_with(
    &Block {
        words,
        n,
        rows,
        varying,
    }: &Block<'_>,
    contents: &mut [u8],
    twins: &mut [u16; TWINS],
    out: &mut [u8],
) -> usize {
    let steps = n.saturating_sub(1);
    twins.fill(0);
    let (mut columns, mut gathered, mut bytes, mut size) =
        ([[0; BLOCK + 1]; LINE], None, [0_u8; PLANES], 0);
    for word in (0..words).filter(|word| varying[*word] != 0) {
        let (first, last) = (rows[word], rows[steps * words + word]);
        let known = &mut twins[ends_of(first, last)];
        let is_twin = |other: usize| {
            varying[other] == varying[word]
                && rows.chunks_exact(words).all(|row| row[other] == row[word])
        };
        if *known > 0 && is_twin(usize::from(*known) - 1) {
            contents[3 * words + 2 * word..][..2].copy_from_slice(&known.to_le_bytes());
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
            let Some(plane) = bytes[byte * BLOCK..].first_chunk() else {
                continue;
            };
            let (kind, length) = put(plane, steps, &mut out[size..]);
            contents[word] |= 1 << byte;
            contents[words + word] |= u8::from(kind == Kind::Plain) << byte;
            contents[2 * words + word] |= u8::from(kind == Kind::Steady) << byte;
            size += length;
        }
    }
    size
}

/// The columns of the words from `begin` on.
#[inline(always)]
fn gather(rows: &[u64], words: usize, begin: usize, columns: &mut [Column; LINE]) {
    let mut rows = rows.chunks_exact(words);
    for k in 0..BLOCK {
        let Some(row) = rows.next() else { break };
        match row[begin..].first_chunk::<LINE>() {
            Some(line) => columns
                .iter_mut()
                .zip(line)
                .for_each(|(column, value)| column[k] = *value),
            None => columns
                .iter_mut()
                .zip(&row[begin..])
                .for_each(|(column, value)| column[k] = *value),
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

/// Bytes of the planes of a column, and before them the zero that stands before the first byte of each: the last byte of all is none of a message's.
const PLANES: usize = 1 + BLOCK * size_of::<u64>();

/// The planes of a column one after the other.
#[inline(always)]
fn apart(column: &Column, bytes: &mut [u8; PLANES]) {
    for (group, rows) in column.as_chunks::<SQUARE>().0.iter().enumerate() {
        for (byte, part) in transposed(rows).as_chunks::<SQUARE>().0.iter().enumerate() {
            bytes[1 + byte * BLOCK + group * SQUARE..][..SQUARE].copy_from_slice(part);
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

/// The form of a plane.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// The bytes that are not zero.
    Sparse,
    /// The bytes that differ from the one before.
    Steady,
    /// All bytes.
    Plain,
}

/// The byte before a plane, and its bytes: zero behind its end.
type Plane = [u8; BLOCK + 1];

/// Writes a plane of so many bytes in its shortest form; returns that and its length.
#[inline(always)]
fn put(plane: &Plane, steps: usize, out: &mut [u8]) -> (Kind, usize) {
    let (sparse, mut steady) = (is_not_zero(plane), is_new(plane));
    // The end of the plane is nothing new.
    steady[steps..].fill(0);
    let count = |flags: &[u8; BLOCK]| usize::from(flags.iter().sum::<u8>());
    let (kind, flags, stored) = match (count(&sparse), count(&steady)) {
        (some, new) if new < some => (Kind::Steady, &steady, new),
        (some, _) => (Kind::Sparse, &sparse, some),
    };
    if steps.div_ceil(8) + stored < steps {
        return (kind, put_masked(plane, flags, steps, out));
    }
    // All of them, a length that is known here: what is too much is written over.
    out[..BLOCK].copy_from_slice(&plane[1..]);
    (Kind::Plain, steps)
}

/// 1 for each byte that is not zero.
#[inline(always)]
fn is_not_zero(plane: &Plane) -> [u8; BLOCK] {
    std::array::from_fn(|k| u8::from(plane[k + 1] != 0))
}

/// 1 for each byte that differs from the one before it.
#[inline(always)]
fn is_new(plane: &Plane) -> [u8; BLOCK] {
    std::array::from_fn(|k| u8::from(plane[k + 1] != plane[k]))
}

/// Writes a mask of so many bits and the bytes whose flags are 1; returns how many bytes.
#[inline(always)]
fn put_masked(plane: &Plane, flags: &[u8; BLOCK], bits: usize, out: &mut [u8]) -> usize {
    // Each of eight bytes that are 0 or 1 at its place in the highest byte of a product; no other sum of theirs comes there.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let Some(out) = out.first_chunk_mut::<ROOM>() else {
        return 0;
    };
    let (masks, mut size) = (bits.div_ceil(8), bits.div_ceil(8));
    for (group, (flags, bytes)) in flags
        .as_chunks::<8>()
        .0
        .iter()
        .zip(plane[1..].as_chunks::<8>().0)
        .enumerate()
        .take(masks)
    {
        let mask = u64::from_le_bytes(*flags).wrapping_mul(GATHER) >> 56;
        out[group] = mask as u8;
        if mask != 0 {
            for (byte, flag) in bytes.iter().zip(flags) {
                // Without a branch: the next one that counts is written over one that does not.
                out[size] = *byte;
                size += usize::from(*flag);
            }
        }
    }
    size
}

/// A block ends before what it tells of.
const EARLY: &str = "a block ends too early";

/// The inverse of [`Packer::pack`], of what follows a block's head: `n` rows of as many words, one after the other.
///
/// # Errors
/// A sentence, where the bytes are no such block.
pub(crate) fn unpack(n: usize, words: usize, packed: &[u8]) -> Result<Vec<u64>, String> {
    let (mut rest, steps, mut begin) = (packed, n.saturating_sub(1), vec![0; BEGIN * words]);
    if n == 0 {
        return Err("a block of no messages has bytes".to_owned());
    }
    for piece in begin.chunks_mut(BLOCK) {
        take_masked(&mut rest, piece, false)?;
    }
    let (contents, first) = begin.split_at(CONTENTS * words);
    let (present, plain, steady) = (
        &contents[..words],
        &contents[words..2 * words],
        &contents[2 * words..3 * words],
    );
    let twins = contents[3 * words..].as_chunks::<2>().0;
    let is_wrong = |word: usize| {
        (plain[word] | steady[word]) & !present[word] != 0 || plain[word] & steady[word] != 0
    };
    if let Some(word) = (0..words).find(|word| is_wrong(*word)) {
        return Err(format!("word {word} of a block has planes of no form"));
    }
    let mut rows = vec![0_u64; n * words];
    rows.iter_mut()
        .zip(first.as_chunks::<8>().0)
        .for_each(|(word, bytes)| *word = u64::from_le_bytes(*bytes));
    let mut plane = vec![0; steps];
    for word in 0..words {
        let twin = usize::from(u16::from_le_bytes(twins[word]));
        if twin > word {
            return Err(format!("word {word} of a block is the twin of a later one"));
        }
        if twin > 0 {
            rows.chunks_exact_mut(words)
                .for_each(|row| row[word] = row[twin - 1]);
            continue;
        }
        for byte in (0..8).filter(|byte| present[word] & 1 << byte != 0) {
            if plain[word] & 1 << byte != 0 {
                let (bytes, behind) = rest.split_at_checked(steps).ok_or(EARLY)?;
                (plane, rest) = (bytes.to_vec(), behind);
            } else {
                take_masked(&mut rest, &mut plane, steady[word] & 1 << byte != 0)?;
            }
            for (row, part) in rows.chunks_exact_mut(words).skip(1).zip(&plane) {
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
    if rest.is_empty() {
        Ok(rows)
    } else {
        Err(format!(
            "{} bytes stand behind the planes of a block",
            rest.len()
        ))
    }
}

/// The inverse of [`put_masked`], for a plane of any length.
fn take_masked(rest: &mut &[u8], plane: &mut [u8], is_steady: bool) -> Result<(), String> {
    let (mask, behind) = rest
        .split_at_checked(plane.len().div_ceil(8))
        .ok_or(EARLY)?;
    let (stored, behind) = behind
        .split_at_checked(mask.iter().map(|byte| byte.count_ones() as usize).sum())
        .ok_or(EARLY)?;
    let (mut stored, mut before) = (stored.iter(), 0);
    for (k, byte) in plane.iter_mut().enumerate() {
        *byte = match mask[k / 8] >> (k % 8) & 1 {
            1 => *stored.next().ok_or(EARLY)?,
            _ if is_steady => before,
            _ => 0,
        };
        before = *byte;
    }
    *rest = behind;
    if stored.next().is_none() {
        Ok(())
    } else {
        Err("a mask of a block is longer than its plane".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::random::at as random;

    const WORDS: usize = 9;

    /// Words that count, stand still, are noise, and repeat another word.
    fn row(k: u64) -> [u64; WORDS] {
        let (count, noise) = (1_000_000 * k + k % 7, random(7, k));
        [
            count,
            0,
            5,
            noise,
            noise >> 40,
            noise,
            count,
            u64::MAX - k,
            f64::to_bits(0.1 * k as f64),
        ]
    }

    #[test]
    fn every_word_comes_back_from_a_block_of_any_length() {
        for n in 1..=BLOCK as u64 {
            let mut packer = Packer::new(WORDS, 7);
            for begin in [0, 1_000] {
                let rows: Vec<u64> = (begin..begin + n).flat_map(row).collect();
                rows.chunks(WORDS).for_each(|row| packer.add(row));
                let (block, messages) = packer.pack();
                let rest = &block[7..];
                assert!(
                    is_possible(messages, rest.len(), 8 * WORDS),
                    "{} bytes of {n} messages",
                    rest.len()
                );
                assert_eq!(
                    unpack(messages, WORDS, rest).as_ref(),
                    Ok(&rows),
                    "{n} rows from {begin}"
                );
                assert!(
                    unpack(messages, WORDS, &rest[..rest.len() - 1]).is_err(),
                    "a byte is missing"
                );
                assert!(
                    unpack(messages, WORDS, &[rest, &[0]].concat()).is_err(),
                    "a byte too many"
                );
            }
        }
    }

    #[test]
    fn a_block_of_noise_alone_is_possible() {
        let (mut packer, words) = (Packer::new(40, 0), 40);
        let rows: Vec<u64> = (0..(BLOCK * words) as u64).map(|k| random(7, k)).collect();
        rows.chunks(words).for_each(|row| packer.add(row));
        let (block, n) = packer.pack();
        assert!(
            is_possible(n, block.len(), 8 * words) && block.len() > 8 * rows.len(),
            "{}",
            block.len()
        );
        assert_eq!(unpack(n, words, block).as_ref(), Ok(&rows));
    }

    #[test]
    fn bytes_that_are_no_block_are_refused_or_give_rows_and_never_more_than_asked_for() {
        let mut packer = Packer::new(WORDS, 0);
        (0..BLOCK as u64).for_each(|k| packer.add(&row(k)));
        let (block, n) = packer.pack();
        for (place, bit) in (0..block.len()).flat_map(|place| (0..8).map(move |bit| (place, bit))) {
            let mut damaged = block.to_vec();
            damaged[place] ^= 1 << bit;
            assert!(
                unpack(n, WORDS, &damaged).is_err_and(|said| !said.is_empty())
                    || unpack(n, WORDS, &damaged).is_ok_and(|rows| rows.len() == n * WORDS)
            );
        }
        assert!(
            unpack(0, WORDS, block).is_err()
                && unpack(1, WORDS, block).is_err()
                && unpack(n, WORDS + 1, block).is_err()
        );
    }

    #[test]
    fn each_plane_has_its_shortest_form_and_a_twin_takes_no_room() {
        let bytes = |make: fn(u64) -> [u64; 2]| {
            let mut packer = Packer::new(2, 0);
            (0..BLOCK as u64).for_each(|k| packer.add(&make(k)));
            packer.pack().0.len()
        };
        let still = bytes(|k| [k * u64::from(k == BLOCK as u64 - 1), 0]);
        assert!(still < 2 * MASK + 10, "one change in {still} bytes");
        let (one, two) = (
            bytes(|k| [random(7, k), 0]),
            bytes(|k| [random(7, k), random(8, k)]),
        );
        assert!(
            two - one >= 8 * (BLOCK - 1) && one < 8 * (BLOCK - 1) + 40,
            "all eight bytes of a random word: {one}, {two}"
        );
        let twins = bytes(|k| [random(7, k), random(7, k)]);
        assert!(twins <= one + 16, "{twins} beside {one}");
        let even = bytes(|k| [k << 32 | k, 3 * k]);
        assert!(
            even < 4 * (MASK + 1) + 40,
            "numbers that change evenly take {even} bytes"
        );
    }
}
