//! A part: its head, and the pass that adds footer and tail once its records are written.

use super::cut::PartId;
use super::head::{self, Tail};
use super::record::{Entry, RecordForm};
use crate::builder::error::BuildError;
use crate::builder::layout::{GroupCounts, StoredChannels};
use crate::builder::merge::{Run, Target};
use crate::builder::seal::for_each_part;
use crate::builder::solid::VoxelBox;
use crate::builder::swap::Scratch;
use crate::builder::walk::{BrickWalk, GROUP_BRICKS};
use crate::format::SurfaceKind;
use crate::geom::Dims;
use crate::platform::FileExt;

/// Bytes read at a time.
const STEP: usize = 128 << 10;

/// A part that is being written.
pub(in crate::builder) struct PartWriter {
    pub(in crate::builder) region: VoxelBox,
    pub(in crate::builder) form: RecordForm,
    pub(in crate::builder) head: Vec<u8>,
}

impl PartWriter {
    pub(in crate::builder) fn new(
        part: &PartId,
        dims: Dims,
        surface: SurfaceKind,
        channels: &StoredChannels,
        metadata: &[u8],
    ) -> Self {
        Self {
            region: part.region(),
            form: RecordForm::new(channels, dims.depth()),
            head: head::write(part, dims, surface, channels, metadata),
        }
    }

    /// Writes head, footer and tail; every record is read back for its CRC. Returns the length of the file.
    ///
    /// Memory: [`STEP`] and the buffer of a run, for any number of groups.
    pub(in crate::builder) fn seal(&self, target: &Target<'_>, scratch: &Scratch) -> Result<u64, BuildError> {
        target.file.write_all_at(&self.head, 0).map_err(|e| target.error(e))?;
        let (mut walk, mut found) = (BrickWalk::of(&self.region), Vec::new());
        let mut footer = self.head.len() as u64;
        while walk.next_group(scratch, &mut found)? {
            footer += self.form.bytes(&GroupCounts::of(&found));
        }
        let (mut run, mut buffer) = (Run::new(Some(footer)), vec![0; STEP]);
        let mut tail = Tail { footer, groups: 0, crc: 0 };
        let (mut walk, mut offset) = (BrickWalk::of(&self.region), self.head.len() as u64);
        while walk.next_group(scratch, &mut found)? {
            let Some((code, _)) = found.first() else { continue };
            let counts = GroupCounts::of(&found);
            let mut entry = Entry { code: code / GROUP_BRICKS as u64, offset, crc: 0, counts };
            let bytes = self.form.bytes(&counts);
            for_each_part(target, offset, bytes, &mut buffer, |part| {
                entry.crc = crc32c::crc32c_append(entry.crc, part);
                Ok(())
            })?;
            let entry = entry.to_bytes();
            tail.crc = crc32c::crc32c_append(tail.crc, &entry);
            tail.groups += 1;
            offset += bytes;
            run.put(target, &entry)?;
        }
        run.put(target, &tail.to_bytes())?;
        run.flush(target)?;
        Ok(footer + tail.groups * entry_bytes() + tail.to_bytes().len() as u64)
    }
}

const fn entry_bytes() -> u64 {
    super::record::ENTRY_BYTES as u64
}
