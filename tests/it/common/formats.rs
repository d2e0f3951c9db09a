//! Small writers of volume formats, each from the bytes of its specification.
#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use std::fs;
use std::path::{Path, PathBuf};

use infobyte::volume::ScalarType;

use super::volume::encode;

pub(crate) use super::compress::{bzip2, gzip, zlib};

/// A volume to be written: samples as little-endian bytes, x fastest, and a diagonal LPS affine.
#[derive(Clone)]
pub(crate) struct Object {
    pub(crate) dims: [u32; 3],
    pub(crate) scalar: ScalarType,
    /// Step along each axis in mm; negative where it runs against L, P or S.
    pub(crate) step: [f64; 3],
    pub(crate) bytes: Vec<u8>,
}

impl Object {
    /// Waves in three directions, scaled to what the type holds.
    pub(crate) fn new(dims: [u32; 3], scalar: ScalarType, step: [f64; 3]) -> Self {
        let (middle, reach) = match scalar {
            ScalarType::U8 => (128.0, 40.0),
            ScalarType::I8 => (0.0, 40.0),
            _ => (1000.0, 300.0),
        };
        let mut bytes = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let [a, b, c] = [x, y, z].map(f64::from);
                    let wave = (a * 0.4).sin() + (b * 0.31 + 1.0).cos() + (c * 0.53).sin() + a * 0.001;
                    encode(scalar, middle + reach * wave, &mut bytes);
                }
            }
        }
        Self { dims, scalar, step, bytes }
    }

    pub(crate) fn big_endian(&self) -> Vec<u8> {
        let mut bytes = self.bytes.clone();
        bytes.chunks_exact_mut(self.scalar.bytes()).for_each(<[u8]>::reverse);
        bytes
    }

    pub(crate) fn ordered(&self, big: bool) -> Vec<u8> {
        if big { self.big_endian() } else { self.bytes.clone() }
    }

    pub(crate) fn slice_bytes(&self) -> usize {
        self.dims[0] as usize * self.dims[1] as usize * self.scalar.bytes()
    }
}

/// The samples as text.
fn numbers(object: &Object) -> Vec<u8> {
    let samples = object.bytes.chunks_exact(object.scalar.bytes());
    let words: Vec<String> = samples.map(|b| super::volume::decode(object.scalar, b).to_string()).collect();
    words.join("\n").into_bytes()
}

/// An NRRD file; `data` is a line that names detached samples.
pub(crate) fn nrrd(object: &Object, encoding: &str, big: bool, data: &str) -> Vec<u8> {
    let names = ["uchar", "int8_t", "ushort", "short", "unsigned int", "int", "float", "double"];
    let [nx, ny, nz] = object.dims;
    let [a, b, c] = object.step;
    let endian = if big { "big" } else { "little" };
    let mut file = format!(
        "NRRD0005\n# made by a test\ntype: {}\ndimension: 3\nspace: right-anterior-superior\nsizes: {nx} {ny} {nz}\n\
         space directions: ({},0,0) (0,{},0) (0,0,{c})\nkinds: domain domain domain\nendian: {endian}\n\
         encoding: {encoding}\nspace origin: (0,0,0)\n{data}",
        names[object.scalar as usize], -a, -b,
    )
    .into_bytes();
    if data.is_empty() {
        file.push(b'\n');
        let samples = object.ordered(big);
        file.extend(match encoding {
            "gzip" => gzip(&samples),
            "bzip2" => bzip2(&samples),
            "ascii" => numbers(object),
            "hex" => samples.iter().map(|b| format!("{b:02x}")).collect::<String>().into_bytes(),
            _ => samples,
        });
    }
    file
}

/// A NIfTI header of version 1 or 2 with an sform; `volumes` is the fourth dimension.
pub(crate) fn nifti(object: &Object, version: u8, big: bool, single: bool, volumes: u16) -> Vec<u8> {
    let codes = [2, 256, 512, 4, 768, 8, 16, 64];
    let code: i16 = codes[object.scalar as usize];
    let bits = (object.scalar.bytes() * 8) as i16;
    let end = if version == 1 { 352 } else { 544 };
    let mut bytes = vec![0; end];
    let mut put = |at: usize, value: &[u8]| {
        let mut value = value.to_vec();
        if big {
            value.reverse();
        }
        bytes[at..at + value.len()].copy_from_slice(&value);
    };
    let dim = [4, object.dims[0], object.dims[1], object.dims[2], u32::from(volumes), 1, 1, 1];
    let [a, b, c] = object.step;
    let rows = [[-a, 0.0, 0.0, 0.0], [0.0, -b, 0.0, 0.0], [0.0, 0.0, c, 0.0]];
    let offset = if single { end } else { 0 };
    if version == 1 {
        put(0, &348_i32.to_le_bytes());
        dim.iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, &(*n as u16).to_le_bytes()));
        put(70, &code.to_le_bytes());
        put(72, &bits.to_le_bytes());
        [a, b, c].iter().enumerate().for_each(|(i, v)| put(80 + 4 * i, &(v.abs() as f32).to_le_bytes()));
        put(108, &(offset as f32).to_le_bytes());
        put(254, &1_i16.to_le_bytes());
        rows.as_flattened()
            .iter()
            .enumerate()
            .for_each(|(i, v)| put(280 + 4 * i, &(*v as f32).to_le_bytes()));
        bytes[123] = 2;
        bytes[344..348].copy_from_slice(if single { b"n+1\0" } else { b"ni1\0" });
    } else {
        put(0, &540_i32.to_le_bytes());
        put(12, &code.to_le_bytes());
        put(14, &bits.to_le_bytes());
        dim.iter().enumerate().for_each(|(i, n)| put(16 + 8 * i, &u64::from(*n).to_le_bytes()));
        [a, b, c].iter().enumerate().for_each(|(i, v)| put(112 + 8 * i, &v.abs().to_le_bytes()));
        put(168, &(offset as u64).to_le_bytes());
        put(348, &1_i32.to_le_bytes());
        rows.as_flattened().iter().enumerate().for_each(|(i, v)| put(400 + 8 * i, &v.to_le_bytes()));
        put(500, &2_i32.to_le_bytes());
        bytes[4..12].copy_from_slice(if single { b"n+2\0\r\n\x1a\n" } else { b"ni2\0\r\n\x1a\n" });
    }
    if !single {
        bytes.truncate(end - 4);
    }
    bytes
}

/// A MetaImage header; `data` is what ElementDataFile names.
pub(crate) fn metaimage(object: &Object, big: bool, compressed: bool, data: &str) -> Vec<u8> {
    let names = ["UCHAR", "CHAR", "USHORT", "SHORT", "UINT", "INT", "FLOAT", "DOUBLE"];
    let [nx, ny, nz] = object.dims;
    let [a, b, c] = object.step;
    let sign = |v: f64| if v < 0.0 { -1 } else { 1 };
    let truth = |t: bool| if t { "True" } else { "False" };
    format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = {}\nCompressedData = {}\n\
         TransformMatrix = {} 0 0 0 {} 0 0 0 {}\nOffset = 0 0 0\nElementSpacing = {} {} {}\n\
         DimSize = {nx} {ny} {nz}\nElementType = MET_{}\nElementDataFile = {data}\n",
        truth(big),
        truth(compressed),
        sign(a),
        sign(b),
        sign(c),
        a.abs(),
        b.abs(),
        c.abs(),
        names[object.scalar as usize],
    )
    .into_bytes()
}

/// A NumPy array of shape z, y, x in C or Fortran order.
pub(crate) fn npy(object: &Object, version: u8, big: bool, fortran: bool) -> Vec<u8> {
    let names = ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"];
    let [nx, ny, nz] = object.dims;
    let shape = [nz, ny, nx];
    let order = if object.scalar.bytes() == 1 {
        '|'
    } else if big {
        '>'
    } else {
        '<'
    };
    let mut header = format!(
        "{{'descr': '{order}{}', 'fortran_order': {}, 'shape': ({}, {}, {}), }}",
        names[object.scalar as usize],
        if fortran { "True" } else { "False" },
        shape[0],
        shape[1],
        shape[2],
    );
    while (header.len() + 13) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut file = b"\x93NUMPY".to_vec();
    file.extend([version, 0]);
    if version == 1 {
        file.extend((header.len() as u16).to_le_bytes());
    } else {
        file.extend((header.len() as u32).to_le_bytes());
    }
    file.extend(header.into_bytes());
    let bytes = object.ordered(big);
    if !fortran {
        file.extend(bytes);
        return file;
    }
    let (nx, ny, nz) = (nx as usize, ny as usize, nz as usize);
    let width = object.scalar.bytes();
    for x in 0..nx {
        for y in 0..ny {
            for z in 0..nz {
                file.extend(&bytes[((z * ny + y) * nx + x) * width..][..width]);
            }
        }
    }
    file
}

/// How a TIFF file is written.
#[derive(Clone, Debug)]
pub(crate) struct Tiff {
    pub(crate) big_endian: bool,
    pub(crate) big_tiff: bool,
    /// 1 none, 5 LZW, 8 deflate, 32773 PackBits.
    pub(crate) compression: u16,
    pub(crate) predictor: u16,
    /// Rows of a strip, or width and height of a tile.
    pub(crate) strip: u32,
    pub(crate) tile: Option<[u32; 2]>,
    pub(crate) description: String,
    /// One directory for all slices.
    pub(crate) contiguous: bool,
    pub(crate) photometric: u16,
    /// The corner that rows and columns begin at; 1 is the upper left.
    pub(crate) orientation: u16,
    /// X and Y resolution in pixels per unit, and what both are divided by.
    pub(crate) resolution: Option<[u32; 2]>,
    pub(crate) divisor: u32,
}

impl Default for Tiff {
    fn default() -> Self {
        Self {
            big_endian: false,
            big_tiff: false,
            compression: 1,
            predictor: 1,
            strip: u32::MAX,
            tile: None,
            description: String::new(),
            contiguous: false,
            photometric: 1,
            orientation: 1,
            resolution: None,
            divisor: 1,
        }
    }
}

impl Tiff {
    fn number(&self, value: u64, width: usize) -> Vec<u8> {
        let mut bytes = value.to_le_bytes()[..width].to_vec();
        if self.big_endian {
            bytes.reverse();
        }
        bytes
    }

    /// A file of all slices of the object.
    pub(crate) fn write(&self, object: &Object) -> Vec<u8> {
        let wide = if self.big_tiff { 8 } else { 4 };
        let mut file = if self.big_endian { b"MM".to_vec() } else { b"II".to_vec() };
        if self.big_tiff {
            file.extend(self.number(43, 2));
            file.extend(self.number(8, 2));
            file.extend(self.number(0, 2));
        } else {
            file.extend(self.number(42, 2));
        }
        let mut link = file.len();
        file.extend(self.number(0, wide));
        let samples = object.ordered(self.big_endian);
        let slices: Vec<&[u8]> =
            if self.contiguous { vec![&samples[..]] } else { samples.chunks(object.slice_bytes()).collect() };
        for slice in slices {
            let (mut offsets, mut counts) = (Vec::new(), Vec::new());
            for chunk in self.chunks(object, slice) {
                offsets.push(file.len() as u64);
                counts.push(chunk.len() as u64);
                file.extend(chunk);
                if self.compression != 1 && file.len() % 2 == 1 {
                    file.push(0);
                }
            }
            let directory = self.directory(object, &mut file, &offsets, &counts);
            let here = self.number(file.len() as u64, wide);
            file[link..link + wide].copy_from_slice(&here);
            link = file.len() + directory.len();
            file.extend(directory);
            file.extend(self.number(0, wide));
        }
        file
    }

    fn directory(&self, object: &Object, file: &mut Vec<u8>, offsets: &[u64], counts: &[u64]) -> Vec<u8> {
        let wide = if self.big_tiff { 8 } else { 4 };
        let format = match object.scalar {
            ScalarType::U8 | ScalarType::U16 | ScalarType::U32 => 1,
            ScalarType::F32 | ScalarType::F64 => 3,
            _ => 2,
        };
        let [nx, ny, _] = object.dims.map(u64::from);
        let long = if self.big_tiff { 16 } else { 4 };
        // Tag, type, width of a value, values.
        let mut entries: Vec<(u16, u16, usize, Vec<u64>)> = vec![
            (256, 4, 4, vec![nx]),
            (257, 4, 4, vec![ny]),
            (258, 3, 2, vec![object.scalar.bytes() as u64 * 8]),
            (259, 3, 2, vec![self.compression.into()]),
            (262, 3, 2, vec![self.photometric.into()]),
        ];
        if !self.description.is_empty() {
            let text = self.description.bytes().map(u64::from).chain([0]).collect();
            entries.push((270, 2, 1, text));
        }
        if self.tile.is_none() {
            entries.push((273, long, wide, offsets.to_vec()));
        }
        if self.orientation != 1 {
            entries.push((274, 3, 2, vec![self.orientation.into()]));
        }
        entries.push((277, 3, 2, vec![1]));
        if self.tile.is_none() {
            entries.push((278, 4, 4, vec![self.strip.into()]));
            entries.push((279, long, wide, counts.to_vec()));
        }
        if let Some(resolution) = self.resolution {
            for (tag, value) in [282, 283].into_iter().zip(resolution) {
                // A ratio: two longs, the numerator first.
                entries.push((tag, 5, 4, vec![value.into(), self.divisor.into()]));
            }
        }
        entries.push((317, 3, 2, vec![self.predictor.into()]));
        if let Some([w, h]) = self.tile {
            entries.push((322, 4, 4, vec![w.into()]));
            entries.push((323, 4, 4, vec![h.into()]));
            entries.push((324, long, wide, offsets.to_vec()));
            entries.push((325, long, wide, counts.to_vec()));
        }
        entries.push((339, 3, 2, vec![format]));
        let mut directory = self.number(entries.len() as u64, if self.big_tiff { 8 } else { 2 });
        for (tag, kind, width, values) in entries {
            let mut bytes: Vec<u8> = values.iter().flat_map(|v| self.number(*v, width)).collect();
            let count = if kind == 5 { values.len() / 2 } else { values.len() };
            directory.extend(self.number(tag.into(), 2));
            directory.extend(self.number(kind.into(), 2));
            directory.extend(self.number(count as u64, wide));
            if bytes.len() > wide {
                let at = self.number(file.len() as u64, wide);
                file.extend(bytes);
                bytes = at;
            }
            bytes.resize(wide, 0);
            directory.extend(bytes);
        }
        directory
    }

    /// The packed strips or tiles of a slice.
    fn chunks(&self, object: &Object, slice: &[u8]) -> Vec<Vec<u8>> {
        if self.contiguous {
            return vec![slice.to_vec()];
        }
        let [nx, ny, _] = object.dims;
        let width = object.scalar.bytes();
        let [w, h] = self.tile.unwrap_or([nx, self.strip.min(ny)]);
        let mut chunks = Vec::new();
        for top in (0..ny).step_by(h as usize) {
            for left in (0..nx).step_by(w as usize) {
                let rows = if self.tile.is_some() { h } else { h.min(ny - top) };
                let mut chunk = Vec::new();
                for y in top..top + rows {
                    let mut row = Vec::new();
                    for x in left..left + w {
                        let at = (y.min(ny - 1) * nx + x.min(nx - 1)) as usize * width;
                        row.extend(&slice[at..at + width]);
                    }
                    chunk.extend(self.predicted(&row, width));
                }
                chunks.push(self.pack(&chunk));
            }
        }
        chunks
    }

    fn predicted(&self, row: &[u8], width: usize) -> Vec<u8> {
        let value = |bytes: &[u8]| {
            let order: Vec<u8> =
                if self.big_endian { bytes.to_vec() } else { bytes.iter().rev().copied().collect() };
            order.iter().fold(0_u64, |sum, b| sum << 8 | u64::from(*b))
        };
        match self.predictor {
            2 => {
                let mut last = 0;
                row.chunks_exact(width)
                    .flat_map(|sample| {
                        let now = value(sample);
                        let difference = now.wrapping_sub(last);
                        last = now;
                        self.number(difference, width)
                    })
                    .collect()
            }
            3 => {
                let values: Vec<u64> = row.chunks_exact(width).map(value).collect();
                let planes: Vec<u8> = (0..width)
                    .flat_map(|plane| values.iter().map(move |v| (v >> (8 * (width - 1 - plane))) as u8))
                    .collect();
                let shifted = [0].iter().chain(&planes);
                planes.iter().zip(shifted).map(|(now, last)| now.wrapping_sub(*last)).collect()
            }
            _ => row.to_vec(),
        }
    }

    fn pack(&self, chunk: &[u8]) -> Vec<u8> {
        match self.compression {
            5 => {
                weezl::encode::Encoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8).encode(chunk).unwrap()
            }
            8 => zlib(chunk),
            32773 => {
                let mut out = Vec::new();
                let mut rest = chunk;
                while let Some(first) = rest.first() {
                    let run = rest.iter().take(128).take_while(|b| *b == first).count();
                    if run > 1 {
                        out.extend([(257 - run) as u8, *first]);
                        rest = &rest[run..];
                        continue;
                    }
                    let literal = rest.len().min(3);
                    out.push(literal as u8 - 1);
                    out.extend(&rest[..literal]);
                    rest = &rest[literal..];
                }
                out
            }
            _ => chunk.to_vec(),
        }
    }
}

/// One PNG picture of 8 or 16 bits for each slice, named so that text order is wrong.
pub(crate) fn pngs(object: &Object, folder: &Path) -> Vec<PathBuf> {
    fs::create_dir_all(folder).unwrap();
    let samples = object.big_endian();
    let slices = samples.chunks(object.slice_bytes()).enumerate();
    slices
        .map(|(z, slice)| {
            let path = folder.join(format!("s{}.png", z + 1));
            let file = fs::File::create(&path).unwrap();
            let mut encoder = png::Encoder::new(file, object.dims[0], object.dims[1]);
            encoder.set_color(png::ColorType::Grayscale);
            let wide = object.scalar.bytes() == 2;
            encoder.set_depth(if wide { png::BitDepth::Sixteen } else { png::BitDepth::Eight });
            let mut writer = encoder.write_header().unwrap();
            writer.write_image_data(slice).unwrap();
            writer.finish().unwrap();
            path
        })
        .collect()
}

/// Writes a file and gives back its path.
pub(crate) fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, bytes).unwrap();
    path
}

/// An MRC map: columns along x, in a rectangular cell; bytes are unsigned by IMOD's mark.
pub(crate) fn mrc(object: &Object, big: bool) -> Vec<u8> {
    let mode = match object.scalar {
        ScalarType::U8 | ScalarType::I8 => 0,
        ScalarType::I16 => 1,
        ScalarType::U16 => 6,
        _ => 2,
    };
    let mut words = [0_u32; 256];
    for axis in 0..3 {
        let side = object.dims[axis];
        (words[axis], words[7 + axis], words[16 + axis]) = (side, side, 1 + axis as u32);
        words[10 + axis] = ((1e7 * f64::from(side) * object.step[axis].abs()) as f32).to_bits();
        words[13 + axis] = 90_f32.to_bits();
    }
    (words[3], words[22]) = (mode, 1);
    words[38] = if object.scalar == ScalarType::U8 { 1_146_047_817 } else { 0 };
    let mut file: Vec<u8> =
        words.iter().flat_map(|word| if big { word.to_be_bytes() } else { word.to_le_bytes() }).collect();
    file[208..212].copy_from_slice(b"MAP ");
    file[212..214].fill(if big { 0x11 } else { 0x44 });
    file.extend(object.ordered(big));
    file
}

/// VTK's structured points, binary.
pub(crate) fn vtk(object: &Object) -> Vec<u8> {
    let names =
        ["unsigned_char", "char", "unsigned_short", "short", "unsigned_int", "int", "float", "double"];
    let ([nx, ny, nz], [a, b, c]) = (object.dims, object.step.map(f64::abs));
    let head = format!(
        "# vtk DataFile Version 3.0\nASCII is only a title\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {nx} {ny} {nz}\n\
         SPACING {a} {b} {c}\nORIGIN 0 0 0\nPOINT_DATA {}\nSCALARS values {} 1\nLOOKUP_TABLE default\n",
        nx * ny * nz,
        names[object.scalar as usize],
    );
    [head.into_bytes(), object.ordered(true)].concat()
}

/// An Amira lattice, raw.
pub(crate) fn amira(object: &Object, big: bool) -> Vec<u8> {
    let names = ["byte", "", "ushort", "short", "", "int", "float", "double"];
    let ([nx, ny, nz], step) = (object.dims, object.step.map(f64::abs));
    let [x, y, z] = [0, 1, 2].map(|axis| f64::from(object.dims[axis] - 1) * step[axis]);
    let order = if big { "BINARY" } else { "BINARY-LITTLE-ENDIAN" };
    let head = format!(
        "# AmiraMesh {order} 2.1\n\n\ndefine Lattice {nx} {ny} {nz}\n\nParameters {{\n    Units {{\n        Coordinates \"mm\"\n    }}\n    \
         Content \"{nx}x{ny}x{nz} values, uniform coordinates\",\n    BoundingBox 0 {x} 0 {y} 0 {z},\n    \
         CoordType \"uniform\"\n}}\n\nLattice {{ {} Data }} @1\n\n# Data section follows\n@1\n",
        names[object.scalar as usize],
    );
    [head.into_bytes(), object.ordered(big)].concat()
}

/// A VGStudio header of samples in a file of their own.
pub(crate) fn vgi(object: &Object, samples: &str) -> Vec<u8> {
    let kind = match object.scalar {
        ScalarType::F32 | ScalarType::F64 => "float",
        ScalarType::I8 | ScalarType::I16 | ScalarType::I32 => "signed integer",
        _ => "unsigned integer",
    };
    let ([nx, ny, nz], [a, b, c]) = (object.dims, object.step.map(f64::abs));
    let bits = 8 * object.scalar.bytes();
    format!(
        "{{volume1}}\n[representation]\nsize = {nx} {ny} {nz}\ndatatype = {kind}\ndatarange = 0 -1\nbitsperelement = {bits}\n\
         [file1]\nSkipHeader = 0\nFileFormat = raw\nSize = {nx} {ny} {nz}\nName = {samples}\nDatatype = {kind}\n\
         BitsPerElement = {bits}\n{{volumeprimitive12}}\n[geometry]\nresolution = {a} {b} {c}\nunit = mm\n[volume]\n\
         volume = volume1\n"
    )
    .into_bytes()
}
