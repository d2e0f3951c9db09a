//! Volumes in memory.

use std::ops::Range;
use std::path::Path;

use infobyte::geom::{Affine, Dims, Orientation};
use infobyte::volume::{Rescale, ScalarType, SourceDescription, SourceError, VolumeInfo, VolumeSource};

/// The sample of type `scalar` next to `v`, as little-endian bytes.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts from floats saturate")]
pub(crate) fn encode(scalar: ScalarType, v: f64, out: &mut Vec<u8>) {
    match scalar {
        ScalarType::U8 => out.extend((v as u8).to_le_bytes()),
        ScalarType::I8 => out.extend((v as i8).to_le_bytes()),
        ScalarType::U16 => out.extend((v as u16).to_le_bytes()),
        ScalarType::I16 => out.extend((v as i16).to_le_bytes()),
        ScalarType::U32 => out.extend((v as u32).to_le_bytes()),
        ScalarType::I32 => out.extend((v as i32).to_le_bytes()),
        ScalarType::F32 => out.extend((v as f32).to_le_bytes()),
        ScalarType::F64 => out.extend(v.to_le_bytes()),
    }
}

/// Writes samples that are a function of their place.
pub(crate) fn write_raw<const BYTES: usize>(
    path: &Path,
    [nx, ny, nz]: [u32; 3],
    sample: impl FnMut([u32; 3]) -> [u8; BYTES],
) {
    let places = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    std::fs::write(path, places.flat_map(sample).collect::<Vec<u8>>()).unwrap();
}

/// The value of a little-endian sample.
pub(crate) fn decode(scalar: ScalarType, b: &[u8]) -> f64 {
    match scalar {
        ScalarType::U8 => f64::from(b[0]),
        ScalarType::I8 => f64::from(b[0].cast_signed()),
        ScalarType::U16 => f64::from(u16::from_le_bytes(b.try_into().unwrap())),
        ScalarType::I16 => f64::from(i16::from_le_bytes(b.try_into().unwrap())),
        ScalarType::U32 => f64::from(u32::from_le_bytes(b.try_into().unwrap())),
        ScalarType::I32 => f64::from(i32::from_le_bytes(b.try_into().unwrap())),
        ScalarType::F32 => f64::from(f32::from_le_bytes(b.try_into().unwrap())),
        ScalarType::F64 => f64::from_le_bytes(b.try_into().unwrap()),
    }
}

/// A volume held as little-endian bytes, x fastest.
pub(crate) struct MemoryVolume {
    info: VolumeInfo,
    pub(crate) bytes: Vec<u8>,
}

impl MemoryVolume {
    /// A volume of the samples next to `values`.
    pub(crate) fn new(dims: [u32; 3], scalar: ScalarType, values: &[f64]) -> Self {
        let size = Dims::new(dims[0], dims[1], dims[2]).unwrap();
        assert_eq!(values.len() as u64, size.voxels());
        let mut bytes = Vec::with_capacity(values.len() * scalar.bytes());
        values.iter().for_each(|v| encode(scalar, *v, &mut bytes));
        let spacing_mm = [1.0; 3];
        let description =
            SourceDescription { format: "memory".into(), name: "volume".into(), ..Default::default() };
        let info = VolumeInfo {
            dims: size,
            scalar,
            rescale: Rescale::IDENTITY,
            spacing_mm,
            affine: Orientation::LPS.affine(spacing_mm),
            description,
            notes: Vec::new(),
        };
        Self { info, bytes }
    }

    /// With another map to physical values.
    pub(crate) fn rescaled(mut self, rescale: Rescale) -> Self {
        self.info.rescale = rescale;
        self
    }

    /// At another place.
    pub(crate) fn placed(mut self, affine: Affine) -> Self {
        self.info.affine = affine;
        self.info.spacing_mm = affine.spacing_mm();
        self
    }

    /// The samples as they really are after encoding.
    pub(crate) fn samples(&self) -> Vec<f64> {
        let scalar = self.info.scalar;
        self.bytes.chunks_exact(scalar.bytes()).map(|b| decode(scalar, b)).collect()
    }

    /// The bytes in big-endian order.
    pub(crate) fn big_endian(&self) -> Vec<u8> {
        let mut bytes = self.bytes.clone();
        bytes.chunks_exact_mut(self.info.scalar.bytes()).for_each(<[u8]>::reverse);
        bytes
    }
}

impl VolumeSource for MemoryVolume {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn read_rows(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        let [nx, ny, _] = self.info.dims.to_array().map(|n| n as usize);
        let width = self.info.scalar.bytes();
        let piece = cols.len() * width;
        assert_eq!(out.len(), rows.len() * piece, "the buffer is exactly as long as what is asked for");
        for (row, part) in rows.zip(out.chunks_exact_mut(piece)) {
            let at = ((z as usize * ny + row as usize) * nx + cols.start as usize) * width;
            part.copy_from_slice(&self.bytes[at..at + piece]);
            if cfg!(target_endian = "big") {
                part.chunks_exact_mut(width).for_each(<[u8]>::reverse);
            }
        }
        Ok(())
    }
}
