//! Writes small DICOM files from parts, sound or hostile, for tests.

use infobyte::volume::VolumeSource;

/// How elements are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Syntax {
    /// 1.2.840.10008.1.2
    ImplicitLe,
    /// 1.2.840.10008.1.2.1
    ExplicitLe,
    /// 1.2.840.10008.1.2.2
    ExplicitBe,
}

impl Syntax {
    pub(crate) const ALL: [Self; 3] = [Self::ImplicitLe, Self::ExplicitLe, Self::ExplicitBe];

    pub(crate) fn uid(self) -> &'static str {
        match self {
            Self::ImplicitLe => "1.2.840.10008.1.2",
            Self::ExplicitLe => "1.2.840.10008.1.2.1",
            Self::ExplicitBe => "1.2.840.10008.1.2.2",
        }
    }
}

/// Bytes of a dataset under construction.
pub(crate) struct Writer {
    pub(crate) bytes: Vec<u8>,
    syntax: Syntax,
}

/// The low 16 bits.
fn low(bits: u32) -> u16 {
    u16::try_from(bits & 0xffff).unwrap()
}

fn length_of(n: usize) -> u32 {
    u32::try_from(n).unwrap()
}

const LONG: [&str; 6] = ["OB", "OD", "OF", "OW", "SQ", "UN"];

impl Writer {
    /// Preamble and meta header; the dataset follows in `syntax`, whatever `uid` claims.
    pub(crate) fn with_meta(syntax: Syntax, uid: &str) -> Self {
        let mut meta = Self { bytes: vec![0; 128], syntax: Syntax::ExplicitLe };
        meta.bytes.extend(b"DICM");
        meta.element(0x0002_0001, "OB", &[0, 1]);
        meta.text(0x0002_0010, "UI", uid);
        meta.syntax = syntax;
        meta
    }

    /// A dataset without preamble and meta header.
    pub(crate) fn bare(syntax: Syntax) -> Self {
        Self { bytes: Vec::new(), syntax }
    }

    /// A sequence of undefined or defined length around items made by `fill`.
    pub(crate) fn sequence(&mut self, tag: u32, defined: bool, items: &[&dyn Fn(&mut Self)]) {
        let mut inner = Self::bare(self.syntax);
        for item in items {
            let mut content = Self::bare(self.syntax);
            item(&mut content);
            if defined {
                inner.element(0xfffe_e000, "", &content.bytes);
            } else {
                inner.head(0xfffe_e000, "", u32::MAX);
                inner.bytes.extend(content.bytes);
                inner.head(0xfffe_e00d, "", 0);
            }
        }
        if defined {
            self.element(tag, "SQ", &inner.bytes);
        } else {
            self.head(tag, "SQ", u32::MAX);
            self.bytes.extend(inner.bytes);
            self.head(0xfffe_e0dd, "", 0);
        }
    }

    /// A sequence of one item.
    pub(crate) fn nest(&mut self, tag: u32, defined: bool, item: impl Fn(&mut Self)) {
        self.sequence(tag, defined, &[&item]);
    }

    pub(crate) fn u16(&mut self, v: u16) {
        self.bytes.extend(if self.syntax == Syntax::ExplicitBe { v.to_be_bytes() } else { v.to_le_bytes() });
    }

    pub(crate) fn u32(&mut self, v: u32) {
        self.bytes.extend(if self.syntax == Syntax::ExplicitBe { v.to_be_bytes() } else { v.to_le_bytes() });
    }

    /// Tag, VR and length only; `u32::MAX` for undefined.
    pub(crate) fn head(&mut self, tag: u32, vr: &str, length: u32) {
        self.u16(low(tag >> 16));
        self.u16(low(tag));
        if self.syntax == Syntax::ImplicitLe || tag >> 16 == 0xfffe {
            return self.u32(length);
        }
        self.bytes.extend(vr.as_bytes());
        if LONG.contains(&vr) {
            self.u16(0);
            self.u32(length);
        } else {
            self.u16(low(length));
        }
    }

    pub(crate) fn element(&mut self, tag: u32, vr: &str, value: &[u8]) {
        self.head(tag, vr, length_of(value.len()));
        self.bytes.extend(value);
    }

    /// A text value, padded to even length.
    pub(crate) fn text(&mut self, tag: u32, vr: &str, value: &str) {
        let mut bytes = value.as_bytes().to_vec();
        if bytes.len() % 2 == 1 {
            bytes.push(if vr == "UI" { 0 } else { b' ' });
        }
        self.element(tag, vr, &bytes);
    }

    pub(crate) fn us(&mut self, tag: u32, value: u16) {
        self.head(tag, "US", 2);
        self.u16(value);
    }

    /// Sequences of every shape: undefined in undefined, defined in undefined, empty, private UN.
    pub(crate) fn clutter(&mut self) {
        self.head(0x0008_1140, "SQ", u32::MAX);
        self.head(0xfffe_e000, "", u32::MAX);
        self.text(0x0008_0060, "CS", "XX");
        self.head(0x0040_a170, "SQ", u32::MAX);
        self.head(0xfffe_e000, "", 0);
        self.head(0xfffe_e0dd, "", 0);
        self.us(0x0028_0010, 9999);
        self.head(0xfffe_e00d, "", 0);
        self.head(0xfffe_e000, "", 12);
        self.bytes.extend([0xaa; 12]);
        self.head(0xfffe_e0dd, "", 0);
        self.head(0x0009_1001, "UN", 5);
        self.bytes.extend(b"odd\xff\xff");
        if self.syntax == Syntax::ExplicitLe {
            // Undefined UN: implicit little-endian inside.
            self.head(0x0009_1002, "UN", u32::MAX);
            let mut inner = Self::bare(Syntax::ImplicitLe);
            inner.head(0xfffe_e000, "", u32::MAX);
            inner.us(0x0009_1003, 7);
            inner.head(0xfffe_e00d, "", 0);
            inner.head(0xfffe_e0dd, "", 0);
            self.bytes.extend(inner.bytes);
        }
        self.head(0x0009_1010, "OB", 70_000);
        self.bytes.extend(vec![0x5a; 70_000]);
    }
}

/// One slice of a CT series.
pub(crate) struct Image<'a> {
    pub(crate) syntax: Syntax,
    pub(crate) meta: bool,
    pub(crate) clutter: bool,
    pub(crate) series: &'a str,
    pub(crate) instance: u32,
    pub(crate) position: [f64; 3],
    pub(crate) orientation: &'a str,
    pub(crate) size: [u16; 2],
    pub(crate) bits: [u16; 2],
    pub(crate) signed: bool,
    pub(crate) rescale: Option<[&'a str; 2]>,
    pub(crate) padding: Option<u16>,
    /// Stored values, row by row, as 32 bits of which the low ones count.
    pub(crate) values: &'a [u32],
}

impl Default for Image<'_> {
    fn default() -> Self {
        Self {
            syntax: Syntax::ExplicitLe,
            meta: true,
            clutter: false,
            series: "1.2.3",
            instance: 1,
            position: [0.0; 3],
            orientation: "1\\0\\0\\0\\1\\0",
            size: [2, 2],
            bits: [16, 16],
            signed: false,
            rescale: Some(["1", "-1024"]),
            padding: None,
            values: &[1, 2, 3, 4],
        }
    }
}

impl Image<'_> {
    /// The whole file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut w = if self.meta {
            Writer::with_meta(self.syntax, self.syntax.uid())
        } else {
            Writer::bare(self.syntax)
        };
        w.text(0x0008_0008, "CS", "ORIGINAL\\PRIMARY\\AXIAL");
        w.text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.2");
        w.text(0x0008_0060, "CS", "CT");
        if self.clutter {
            w.clutter();
        }
        w.text(0x0010_0010, "PN", "Nobody^Real");
        w.text(0x0018_0050, "DS", "2.5");
        w.text(0x0020_000e, "UI", self.series);
        w.text(0x0020_0013, "IS", &self.instance.to_string());
        let [x, y, z] = self.position;
        w.text(0x0020_0032, "DS", &format!("{x}\\{y}\\{z}"));
        w.text(0x0020_0037, "DS", self.orientation);
        w.us(0x0028_0002, 1);
        w.text(0x0028_0004, "CS", "MONOCHROME2");
        w.us(0x0028_0010, self.size[1]);
        w.us(0x0028_0011, self.size[0]);
        w.text(0x0028_0030, "DS", "0.75\\0.5");
        w.us(0x0028_0100, self.bits[0]);
        w.us(0x0028_0101, self.bits[1]);
        w.us(0x0028_0102, self.bits[1] - 1);
        w.us(0x0028_0103, self.signed.into());
        if let Some(padding) = self.padding {
            w.us(0x0028_0120, padding);
        }
        if let Some([slope, intercept]) = self.rescale {
            w.text(0x0028_1052, "DS", intercept);
            w.text(0x0028_1053, "DS", slope);
        }
        let width = usize::from(self.bits[0] / 8);
        let odd = self.values.len() * width % 2;
        w.head(0x7fe0_0010, if width == 1 { "OB" } else { "OW" }, length_of(self.values.len() * width + odd));
        for value in self.values {
            let mut bytes = value.to_le_bytes()[..width].to_vec();
            if self.syntax == Syntax::ExplicitBe {
                bytes.reverse();
            }
            w.bytes.extend(bytes);
        }
        w.bytes.extend(vec![0; odd]);
        w.text(0xfffc_fffc, "OB", "tail");
        w.bytes
    }
}

/// A file as its elements, each of which can be set or taken away; explicit little-endian.
#[derive(Clone)]
pub(crate) struct Elements {
    by_tag: std::collections::BTreeMap<u32, (&'static str, Vec<u8>)>,
}

impl Elements {
    /// A CT image of 2x2 pixels at `z` mm, with the SOP Instance UID `1.2.3.z.instance`.
    pub(crate) fn ct(z: f64, instance: i32, values: [u16; 4]) -> Self {
        let mut image = Self { by_tag: std::collections::BTreeMap::new() };
        image.set(0x0008_0008, "CS", "ORIGINAL\\PRIMARY\\AXIAL");
        image.set(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.2");
        image.set(0x0008_0018, "UI", &format!("1.2.3.{}.{instance}", (z * 1000.0).abs()));
        image.set(0x0008_0060, "CS", "CT");
        image.set(0x0010_0010, "PN", "Nobody^Real Jo");
        image.set(0x0010_0020, "LO", "ID-4711");
        image.set(0x0018_0050, "DS", "2.5");
        image.set(0x0020_000e, "UI", "1.2.3");
        image.set(0x0020_0011, "IS", "7");
        image.set(0x0020_0013, "IS", &instance.to_string());
        image.set(0x0020_0032, "DS", &format!("0\\0\\{z}"));
        image.set(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0");
        image.us(0x0028_0002, 1);
        image.set(0x0028_0004, "CS", "MONOCHROME2");
        image.us(0x0028_0010, 2);
        image.us(0x0028_0011, 2);
        image.set(0x0028_0030, "DS", "0.75\\0.5");
        image.us(0x0028_0100, 16);
        image.us(0x0028_0101, 16);
        image.us(0x0028_0102, 15);
        image.us(0x0028_0103, 0);
        image.set(0x0028_1052, "DS", "-1024");
        image.set(0x0028_1053, "DS", "1");
        image.by_tag.insert(0x7fe0_0010, ("OW", values.iter().flat_map(|v| v.to_le_bytes()).collect()));
        image
    }

    /// Sets a text.
    pub(crate) fn set(&mut self, tag: u32, vr: &'static str, value: &str) -> &mut Self {
        let mut bytes = value.as_bytes().to_vec();
        if bytes.len() % 2 == 1 {
            bytes.push(if vr == "UI" { 0 } else { b' ' });
        }
        self.by_tag.insert(tag, (vr, bytes));
        self
    }

    /// Sets a 16-bit number.
    pub(crate) fn us(&mut self, tag: u32, value: u16) -> &mut Self {
        self.by_tag.insert(tag, ("US", value.to_le_bytes().to_vec()));
        self
    }

    /// Sets a value as it is in the file, of an even number of bytes.
    pub(crate) fn raw(&mut self, tag: u32, vr: &'static str, value: &[u8]) -> &mut Self {
        self.by_tag.insert(tag, (vr, value.to_vec()));
        self
    }

    /// Takes an element away.
    pub(crate) fn without(&mut self, tag: u32) -> &mut Self {
        self.by_tag.remove(&tag);
        self
    }

    /// As [`Elements::set`], of a copy.
    pub(crate) fn with(&self, tag: u32, vr: &'static str, value: &str) -> Self {
        let mut copy = self.clone();
        copy.set(tag, vr, value);
        copy
    }

    /// The whole file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut writer = Writer::with_meta(Syntax::ExplicitLe, Syntax::ExplicitLe.uid());
        for (tag, (vr, value)) in &self.by_tag {
            writer.element(*tag, vr, value);
        }
        writer.bytes
    }

    /// The whole file, its pixels as these fragments in the transfer syntax `uid`.
    pub(crate) fn encapsulated(&self, uid: &str, fragments: &[Vec<u8>]) -> Vec<u8> {
        let mut writer = Writer::with_meta(Syntax::ExplicitLe, uid);
        for (tag, (vr, value)) in &self.by_tag {
            if *tag != 0x7fe0_0010 {
                writer.element(*tag, vr, value);
            }
        }
        writer.head(0x7fe0_0010, "OB", u32::MAX);
        writer.element(0xfffe_e000, "", &[]);
        for fragment in fragments {
            writer.element(0xfffe_e000, "", fragment);
        }
        writer.head(0xfffe_e0dd, "", 0);
        writer.bytes
    }
}

/// The private header of a Siemens image, in its newer form (CSA2) or its older one (CSA1): names of tags
/// and the texts of their items.
pub(crate) fn csa(newer: bool, tags: &[(&str, &[&str])]) -> Vec<u8> {
    let mut out = Vec::new();
    let put = |out: &mut Vec<u8>, numbers: &[u32]| out.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
    if newer {
        out.extend(b"SV10\x04\x03\x02\x01");
    }
    put(&mut out, &[length_of(tags.len()), 77]);
    let first = tags.first().map_or(0, |(_, items)| length_of(items.len()));
    for (name, items) in tags {
        let end = out.len() + 64;
        out.extend(name.as_bytes());
        out.resize(end, 0);
        put(&mut out, &[length_of(items.len())]);
        out.extend(b"FD\0\0");
        put(&mut out, &[4, length_of(items.len()), 77]);
        for text in *items {
            let bytes = length_of(text.len());
            put(
                &mut out,
                &if newer { [bytes, bytes, 77, bytes] } else { [bytes + first, bytes + first, 77, bytes] },
            );
            out.extend(text.as_bytes());
            out.resize(out.len().next_multiple_of(4), 0);
        }
    }
    out
}

/// A Siemens mosaic of `slices` slices as an oblique EPI image has them: `size` is that of a tile, and the
/// samples of tile k, row j, column i are `value(k, j, i)`; what is left over is 0. `normal` is the stated
/// direction of the slices.
pub(crate) fn mosaic(
    slices: u16,
    size: [u16; 2],
    orientation: &str,
    normal: &[&str; 3],
    value: &dyn Fn(u16, u16, u16) -> u16,
) -> Elements {
    let across = (1..).find(|n| n * n >= slices).unwrap();
    let [columns, rows] = size.map(|side| side * across);
    let mut pixels = Vec::new();
    for y in 0..rows {
        for x in 0..columns {
            let tile = y / size[1] * across + x / size[0];
            let value = if tile < slices { value(tile, y % size[1], x % size[0]) } else { 0 };
            pixels.extend(value.to_le_bytes());
        }
    }
    let mut image = Elements::ct(0.0, 1, [0; 4]);
    image.set(0x0008_0008, "CS", "ORIGINAL\\PRIMARY\\M\\ND\\MOSAIC");
    image.set(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.4").set(0x0008_0060, "CS", "MR");
    image.set(0x0018_0050, "DS", "2.5").set(0x0018_0088, "DS", "3");
    image.set(0x0019_0010, "LO", "SIEMENS MR HEADER").us(0x0019_100a, slices);
    image.set(0x0020_0032, "DS", "-805\\-825.5\\-75.25").set(0x0020_0037, "DS", orientation);
    image.us(0x0028_0010, rows).us(0x0028_0011, columns).set(0x0028_0030, "DS", "1.5\\1.25");
    image.without(0x0028_1052).without(0x0028_1053);
    image.set(0x0029_0010, "LO", "SIEMENS CSA HEADER");
    let number = format!("{slices:<8}");
    let header = [
        ("EchoLinePosition", &["64      ", "", "", "", "", ""][..]),
        ("B_value", &[]),
        ("NumberOfImagesInMosaic", &[&number, "", "", "", "", ""]),
        ("SliceNormalVector", normal),
        ("Filter1", &[]),
    ];
    image.raw(0x0029_1010, "OB", &csa(true, &header)).raw(0x7fe0_0010, "OW", &pixels);
    image
}

/// The first sample of each slice.
pub(crate) fn firsts(source: &dyn VolumeSource) -> Vec<u16> {
    let read = |z| {
        let mut out = [0; 2];
        source.read_rows(z, 0..1, 0..1, &mut out).unwrap();
        u16::from_le_bytes(out)
    };
    (0..source.info().dims.nz()).map(read).collect()
}
