//! Looks of triangles by their numbers: a scratch file for each kind, with holes where triangles lack it.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use crate::platform::FileExt;

use super::super::read::Look;

/// Numbers of a triangle's kinds: material with part and kinds, colours, places and normals.
const NUMBERS: [usize; 4] = [2, 9, 6, 9];
/// Bytes written at a time.
const BUFFER: usize = 32 << 10;

#[derive(Debug, Default)]
struct Column {
    file: Option<File>,
    buffer: Vec<u8>,
    /// Triangle that the buffer begins with.
    first: u64,
}

impl Column {
    fn flush(&mut self, record: usize) -> io::Result<()> {
        if let (Some(file), false) = (&self.file, self.buffer.is_empty()) {
            file.write_all_at(&self.buffer, self.first * record as u64)?;
        }
        self.buffer.clear();
        Ok(())
    }

    fn put(&mut self, number: u64, values: &[u32], folder: &Path) -> io::Result<()> {
        let record = 4 * values.len();
        if self.file.is_none() {
            self.file = Some(crate::scratch::unnamed(folder)?);
        }
        let next = self.first + (self.buffer.len() / record) as u64;
        if next != number || self.buffer.len() + record > BUFFER {
            self.flush(record)?;
        }
        if self.buffer.is_empty() {
            self.first = number;
        }
        self.buffer.extend_from_slice(bytemuck::cast_slice(values));
        Ok(())
    }

    fn get<const N: usize>(&self, number: u32) -> io::Result<[f32; N]> {
        let mut values = [0.0_f32; N];
        if let Some(file) = &self.file {
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
            file.read_exact_at(bytes, u64::from(number) * 4 * N as u64)?;
        }
        Ok(values)
    }
}

#[derive(Debug)]
pub(super) struct Columns {
    kinds: [Column; 4],
    count: u64,
    folder: PathBuf,
}

fn three<const N: usize>(flat: &[f32]) -> [[f32; N]; 3] {
    std::array::from_fn(|corner| {
        std::array::from_fn(|k| flat.get(N * corner + k).copied().unwrap_or_default())
    })
}

impl Columns {
    pub(super) fn new(folder: &Path) -> Self {
        Self { kinds: Default::default(), count: 0, folder: folder.to_path_buf() }
    }

    /// Appends what the next triangle carries.
    pub(super) fn put(&mut self, look: &Look) -> io::Result<()> {
        let Look { colors, places, normals, material, part } = look;
        let values = [
            colors.as_ref().map(|of| of.as_flattened()),
            places.as_ref().map(|of| of.as_flattened()),
            normals.as_ref().map(|of| of.as_flattened()),
        ];
        let kinds = (0..3).fold(0, |kinds, k| kinds | u32::from(values[k].is_some()) << k);
        let number = self.count;
        self.count += 1;
        let [base, others @ ..] = &mut self.kinds;
        base.put(number, &[*material, part & 0xff | kinds << 8], &self.folder)?;
        for (column, values) in others.iter_mut().zip(values) {
            if let Some(values) = values {
                column.put(number, bytemuck::cast_slice(values), &self.folder)?;
            }
        }
        Ok(())
    }

    /// Writes what still waits.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        for (column, numbers) in self.kinds.iter_mut().zip(NUMBERS) {
            column.flush(4 * numbers)?;
            column.buffer = Vec::new();
        }
        Ok(())
    }

    pub(super) fn get(&self, number: u32) -> io::Result<Look> {
        let [base, colors, places, normals] = &self.kinds;
        let [material, more] = base.get::<2>(number)?.map(f32::to_bits);
        let has = |kind: u32| more >> (8 + kind) & 1 == 1;
        Ok(Look {
            colors: if has(0) { Some(three(&colors.get::<9>(number)?)) } else { None },
            places: if has(1) { Some(three(&places.get::<6>(number)?)) } else { None },
            normals: if has(2) { Some(three(&normals.get::<9>(number)?)) } else { None },
            material,
            part: more & 0xff,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::read::NO_MATERIAL;
    use super::*;

    #[test]
    fn triangles_get_back_what_they_carry() {
        let folder = tempfile::tempdir().unwrap();
        let mut columns = Columns::new(folder.path());
        let look = |at: u32| {
            #[expect(clippy::cast_precision_loss, reason = "small")]
            let v = at as f32;
            Look {
                colors: at.is_multiple_of(3).then_some([[v, 0.5, 0.25], [1.0, v, 0.0], [0.0, 0.0, v]]),
                places: at.is_multiple_of(7).then_some([[v, -v], [0.0, 1.0], [v, v]]),
                normals: at.is_multiple_of(2).then_some([[v; 3], [1.0; 3], [-v; 3]]),
                material: if at.is_multiple_of(5) { NO_MATERIAL } else { at },
                part: at % 256,
            }
        };
        for at in 0..5000 {
            columns.put(&look(at)).unwrap();
        }
        columns.flush().unwrap();
        for at in [0, 1, 6, 7, 42, 4095, 4998, 4999] {
            assert_eq!(columns.get(at).unwrap(), look(at));
        }
        assert!(columns.get(5000).is_err());
    }
}
