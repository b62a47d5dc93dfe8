//! Records of MCAP as bytes: an opcode, a length of 8 bytes, and a body. All integers are little endian.

pub(crate) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

pub(crate) const HEADER: u8 = 0x01;
pub(crate) const FOOTER: u8 = 0x02;
pub(crate) const SCHEMA: u8 = 0x03;
pub(crate) const CHANNEL: u8 = 0x04;
pub(crate) const MESSAGE: u8 = 0x05;
pub(crate) const CHUNK: u8 = 0x06;
pub(crate) const MESSAGE_INDEX: u8 = 0x07;
pub(crate) const CHUNK_INDEX: u8 = 0x08;
pub(crate) const STATISTICS: u8 = 0x0b;
pub(crate) const DATA_END: u8 = 0x0f;
/// Opcodes from 0x80 on are an application's own: other readers pass over them.
pub(crate) const SEAL: u8 = 0x80;

/// Bytes of opcode and length.
pub(crate) const PREFIX: usize = 9;

/// Appends a record.
pub(crate) fn record(out: &mut Vec<u8>, op: u8, body: impl FnOnce(&mut Vec<u8>)) {
    out.push(op);
    let at = out.len();
    out.extend(0_u64.to_le_bytes());
    body(out);
    let length = (out.len() - at - size_of::<u64>()) as u64;
    out[at..at + size_of::<u64>()].copy_from_slice(&length.to_le_bytes());
}

/// Appends an item after its length in 4 bytes: a text, a list or a map.
pub(crate) fn sized(out: &mut Vec<u8>, body: impl FnOnce(&mut Vec<u8>)) {
    let at = out.len();
    out.extend(0_u32.to_le_bytes());
    body(out);
    let length = (out.len() - at - size_of::<u32>()) as u32;
    out[at..at + size_of::<u32>()].copy_from_slice(&length.to_le_bytes());
}

pub(crate) fn text(out: &mut Vec<u8>, text: &str) {
    sized(out, |out| out.extend(text.as_bytes()));
}

pub(crate) fn numbers<const N: usize>(out: &mut Vec<u8>, numbers: [u64; N]) {
    out.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}

/// The integer at a place; zero if there are no such bytes.
pub(crate) fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u64_of(bytes, at, size_of::<u16>()) as u16
}

pub(crate) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64_of(bytes, at, size_of::<u64>())
}

/// One of up to 8 bytes.
pub(crate) fn u64_of(bytes: &[u8], at: usize, length: usize) -> u64 {
    let mut number = [0; 8];
    if let Some(part) = at.checked_add(length).and_then(|end| bytes.get(at..end)) {
        number[..length].copy_from_slice(part);
    }
    u64::from_le_bytes(number)
}
