//! Files that are changed and have right checksums again, and what `verify` says of them.

use infobyte::format::{FormatError, HEADER_BYTES, SectionKind, table_bytes};
use infobyte::load::{Fault, Frame, verify};

/// A file with another header, section table or content: the table's own checksum and the header's are made right.
pub(crate) fn forged(file: &[u8], change: impl FnOnce(&mut Frame, &mut Vec<u8>)) -> Vec<u8> {
    let (mut frame, mut file) = (Frame::read(file).unwrap(), file.to_vec());
    let old = table_bytes(&frame.sections).len();
    change(&mut frame, &mut file);
    let table = table_bytes(&frame.sections);
    assert_eq!(table.len(), old);
    frame.header.table_crc = crc32c::crc32c(&table);
    file[HEADER_BYTES..HEADER_BYTES + table.len()].copy_from_slice(&table);
    file[..HEADER_BYTES].copy_from_slice(&frame.header.to_bytes());
    file
}

/// A mapped file with another content of one section, and its checksums.
pub(crate) fn with_section(file: &[u8], kind: SectionKind, change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    forged(file, |frame, file| {
        let entry = frame.sections.iter_mut().find(|entry| entry.kind == Some(kind)).unwrap();
        let content = &mut file[entry.offset as usize..entry.end() as usize];
        change(content);
        entry.stored_crc = crc32c::crc32c(content);
        entry.content_crc = entry.stored_crc;
    })
}

/// The fault that `verify` finds.
pub(crate) fn fault_of(file: &[u8]) -> FormatError {
    match verify(file) {
        Err(Fault::Format(fault)) => fault,
        other => panic!("{other:?}"),
    }
}
