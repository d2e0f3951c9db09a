//! Looks of triangles by their numbers: a scratch file for each kind, with holes where triangles lack it.

use std::io;
use std::path::Path;

use crate::scratch::Appended;

use super::super::read::Appearance;

/// Bytes written at a time.
const BUFFER: usize = 32 << 10;

/// The numbers of a triangle in a column.
fn record<const N: usize>(column: &Appended, number: u32) -> io::Result<[f32; N]> {
    let mut values = [0.0_f32; N];
    column.read_at(bytemuck::cast_slice_mut(&mut values), u64::from(number) * 4 * N as u64)?;
    Ok(values)
}

pub(super) struct Columns {
    /// Material with part and kinds, colours, places and normals.
    kinds: [Appended; 4],
    count: u64,
}

fn three<const N: usize>(flat: &[f32]) -> [[f32; N]; 3] {
    std::array::from_fn(|corner| {
        std::array::from_fn(|k| flat.get(N * corner + k).copied().unwrap_or_default())
    })
}

impl Columns {
    pub(super) fn new(folder: &Path) -> Self {
        Self { kinds: std::array::from_fn(|_| Appended::new(folder, BUFFER)), count: 0 }
    }

    /// Appends the look of the next triangle.
    pub(super) fn put(&mut self, look: &Appearance) -> io::Result<()> {
        let Appearance { colors, places, normals, material, part } = look;
        let values = [
            colors.as_ref().map(|of| of.as_flattened()),
            places.as_ref().map(|of| of.as_flattened()),
            normals.as_ref().map(|of| of.as_flattened()),
        ];
        let kinds = (0..3).fold(0, |kinds, k| kinds | u32::from(values[k].is_some()) << k);
        let number = self.count;
        self.count += 1;
        let base = [*material, part & 0xff | kinds << 8];
        let values = [Some(bytemuck::cast_slice(&base)), values[0], values[1], values[2]];
        for (column, values) in self.kinds.iter_mut().zip(values) {
            if let Some(values) = values {
                column.push_at(number * size_of_val(values) as u64, bytemuck::cast_slice(values))?;
            }
        }
        Ok(())
    }

    /// Writes the bytes that still wait.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        for column in &mut self.kinds {
            column.flush()?;
            column.shrink();
        }
        Ok(())
    }

    pub(super) fn get(&self, number: u32) -> io::Result<Appearance> {
        let [base, colors, places, normals] = &self.kinds;
        let [material, more] = record::<2>(base, number)?.map(f32::to_bits);
        let has = |kind: u32| more >> (8 + kind) & 1 == 1;
        Ok(Appearance {
            colors: if has(0) { Some(three(&record::<9>(colors, number)?)) } else { None },
            places: if has(1) { Some(three(&record::<6>(places, number)?)) } else { None },
            normals: if has(2) { Some(three(&record::<9>(normals, number)?)) } else { None },
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
            let v = at as f32;
            Appearance {
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
