//! The packer of chunks.

use re_log_encoding::external::lz4_flex::block::{CompressTable, compress_into_with_table, get_maximum_output_size};

/// LZ4 with its memory.
#[derive(Default)]
pub(crate) struct Packer {
    packed: Vec<u8>,
    /// For less than 64 KiB.
    small: CompressTable,
    large: Option<CompressTable>,
}

impl Packer {
    /// Bytes as an LZ4 block; `None` where it wants more room than its worst case.
    pub(crate) fn pack(&mut self, bytes: &[u8]) -> Option<&[u8]> {
        let most = get_maximum_output_size(bytes.len());
        if self.packed.len() < most {
            self.packed.resize(most, 0);
        }
        let table = if bytes.len() < usize::from(u16::MAX) { &mut self.small } else { self.large.get_or_insert_with(CompressTable::large) };
        let size = compress_into_with_table(bytes, &mut self.packed, table).ok()?;
        Some(&self.packed[..size])
    }
}
