//! Pictures in memory and as PNG files.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::RenderError;
use super::shade::Shader;
use crate::atomic::AtomicFile;
use crate::fault::usage;
use crate::picture_mark::{KEYWORD, PROGRAM};
use crate::render::RenderFault;

/// Pictures with more pixels than thumbnails are compressed fast: a quarter to a third larger, in a twentieth to a
/// fortieth of the time, which was longer than tracing them. All rows use one filter: choosing the best for each takes
/// as long as all the rest, for 2 % fewer bytes.
const MAX_SMALL: u64 = 1 << 18;

/// Compression level of smaller pictures. For a thumbnail of 256^2, in ms and bytes: level 3 5.1 and 40,264, the usual
/// 6 16.6 and 38,220, 2 3.4 and 42,618, fast .7 and 51,073; all the rest of making it takes some 30 ms.
const SMALL_LEVEL: png::DeflateCompression = png::DeflateCompression::Level(3);

/// Speed of choosing palettes of GIF, 1 to 30: at 10 from a tenth of the pixels.
const GIF_SPEED: i32 = 10;

/// Least delay in hundredths of a second; browsers replace shorter ones by ten.
const MIN_DELAY: u16 = 2;

/// A picture, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// sRGB with straight alpha; the background is 0, 0, 0, 0.
    pub rgba: Vec<u8>,
    /// Depth, if requested: 0 for background, else 1..=65535 from the nearest to the farthest depth of the model,
    /// evenly (the report states both in mm; depth is along the camera's forward axis).
    pub depth: Option<Vec<u16>>,
    /// World normals, if requested: each component from -1..=1 to 1..=255, 128 for 0; background 0, 0, 0.
    pub normals: Option<Vec<u8>>,
    /// Three numbers of 16 bits a pixel, if requested, together 48 bits, the highest first: the breadth-first number of
    /// the box that was hit (SPEC 2: nodes before voxels), plus 1; for a model of labels the number of the label;
    /// background 0.
    pub ids: Option<Vec<u16>>,
}

impl Image {
    /// Writes the picture as a PNG with a transparent background.
    ///
    /// The file appears whole or not at all: it is written under another name in its folder and renamed.
    ///
    /// # Errors
    /// [`RenderError`] when the folder is missing or the disk refuses.
    pub fn write_png(&self, path: impl AsRef<Path>) -> Result<(), RenderError> {
        self.write_layer_to(ImageFile::create(path.as_ref())?, PngLayer::Color)
    }

    /// Writes the picture as a PNG to any writer, such as a `Vec<u8>`: the bytes of [`Image::write_png`].
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/v1.0-mapped.oct");
    /// # let model = infobyte::Model::open(path)?;
    /// # let request = infobyte::RenderRequest { size: Some([64, 64]), ..Default::default() };
    /// let (image, _) = infobyte::render(&model, &request)?;
    /// let mut png = Vec::new();
    /// image.write_png_to(&mut png)?;
    /// assert!(png.starts_with(b"\x89PNG"));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// The errors of `out`, or a picture whose number of pixels does not match its sides.
    pub fn write_png_to(&self, out: impl Write) -> io::Result<()> {
        let mut writer = encoder(out, PngLayer::Color, [self.width, self.height])?.write_header()?;
        let mut rows = writer.stream_writer_with_size(CHUNK)?;
        rows.write_all(&self.rgba)?;
        rows.finish()?;
        Ok(writer.finish()?)
    }

    /// Writes the depth as a 16-bit grey PNG.
    ///
    /// # Errors
    /// [`RenderError`] when the picture was made without depth; else the errors of [`Image::write_png`].
    pub fn write_depth_png(&self, path: impl AsRef<Path>) -> Result<(), RenderError> {
        self.write_layer_to(ImageFile::create(path.as_ref())?, PngLayer::Depth)
    }

    /// Writes the normals as an RGB PNG.
    ///
    /// # Errors
    /// [`RenderError`] when the picture was made without normals; else the errors of [`Image::write_png`].
    pub fn write_normals_png(&self, path: impl AsRef<Path>) -> Result<(), RenderError> {
        self.write_layer_to(ImageFile::create(path.as_ref())?, PngLayer::Normals)
    }

    /// Writes the numbers of boxes as a 16-bit RGB PNG.
    ///
    /// # Errors
    /// [`RenderError`] when the picture was made without them; else the errors of [`Image::write_png`].
    pub fn write_ids_png(&self, path: impl AsRef<Path>) -> Result<(), RenderError> {
        self.write_layer_to(ImageFile::create(path.as_ref())?, PngLayer::Ids)
    }

    /// Puts an opaque background (sRGB) behind the colours; partly covered pixels are mixed in linear light.
    pub(crate) fn lay_on(&mut self, background: [u8; 3]) {
        let shader = Shader::new();
        let behind = shader.decode(background);
        for pixel in self.rgba.as_chunks_mut::<4>().0 {
            let [r, g, b, alpha] = *pixel;
            let [r, g, b] = match alpha {
                0 => background,
                255 => [r, g, b],
                _ => {
                    let (front, part) = (shader.decode([r, g, b]), f64::from(alpha) / 255.0);
                    [0, 1, 2].map(|c| shader.encode(behind[c] + part * (front[c] - behind[c])))
                }
            };
            *pixel = [r, g, b, 255];
        }
    }

    /// An empty picture of this size, with the layers that are true: depth, normals, numbers of boxes.
    pub(crate) fn blank([width, height]: [u32; 2], [depth, normals, ids]: [bool; 3]) -> Self {
        let mut image = Self {
            width,
            height: 0,
            rgba: Vec::new(),
            depth: depth.then(Vec::new),
            normals: normals.then(Vec::new),
            ids: ids.then(Vec::new),
        };
        image.clear(height);
        image
    }

    /// Layers besides colours, in the form that [`Image::blank`] takes.
    pub(crate) fn layers(&self) -> [bool; 3] {
        [self.depth.is_some(), self.normals.is_some(), self.ids.is_some()]
    }

    /// This picture with another one of its height and layers on its right.
    pub(crate) fn beside(&self, other: &Self) -> Self {
        fn rows<T: Copy>([one, other]: [&[T]; 2], [wide, high]: [u32; 2], more: u32, items: usize) -> Vec<T> {
            let side = |pixels: u32| pixels as usize * items;
            (0..high as usize)
                .flat_map(|y| [&one[y * side(wide)..][..side(wide)], &other[y * side(more)..][..side(more)]])
                .flatten()
                .copied()
                .collect()
        }
        let size = [self.width, self.height.min(other.height)];
        let more = other.width;
        fn both<'a, T>(one: &'a Option<Vec<T>>, other: &'a Option<Vec<T>>) -> Option<[&'a [T]; 2]> {
            Some([one.as_deref()?, other.as_deref()?])
        }
        Self {
            width: self.width + more,
            height: size[1],
            rgba: rows([&self.rgba, &other.rgba], size, more, 4),
            depth: both(&self.depth, &other.depth).map(|layers| rows(layers, size, more, 1)),
            normals: both(&self.normals, &other.normals).map(|layers| rows(layers, size, more, 3)),
            ids: both(&self.ids, &other.ids).map(|layers| rows(layers, size, more, 3)),
        }
    }

    /// Writes a layer to a file that was begun before.
    pub(crate) fn write_layer_to(&self, file: ImageFile, layer: PngLayer) -> Result<(), RenderError> {
        let mut rows = PngRows::begin(file, layer, [self.width, self.height])?;
        rows.put(self)?;
        rows.finish()
    }

    /// Empties the picture, and gives it this many rows.
    pub(crate) fn clear(&mut self, rows: u32) {
        let pixels = self.width as usize * rows as usize;
        self.height = rows;
        refill(&mut self.rgba, pixels * 4, 0);
        self.normals.iter_mut().for_each(|normals| refill(normals, pixels * 3, 0));
        self.depth.iter_mut().for_each(|depth| refill(depth, pixels, 0));
        self.ids.iter_mut().for_each(|ids| refill(ids, pixels * 3, 0));
    }

    /// Reserves memory for this many rows in total.
    pub(crate) fn reserve(&mut self, rows: u32) {
        let pixels = self.width as usize * rows as usize;
        self.rgba.reserve_exact(pixels * 4);
        self.normals.iter_mut().for_each(|normals| normals.reserve_exact(pixels * 3));
        self.depth.iter_mut().for_each(|depth| depth.reserve_exact(pixels));
        self.ids.iter_mut().for_each(|ids| ids.reserve_exact(pixels * 3));
    }

    /// Adds the rows of a part that has the same layers.
    pub(crate) fn append(&mut self, part: &Self) {
        fn add<T: Copy>(to: &mut Option<Vec<T>>, from: &Option<Vec<T>>) {
            if let (Some(to), Some(from)) = (to, from) {
                to.extend_from_slice(from);
            }
        }
        self.height += part.height;
        self.rgba.extend_from_slice(&part.rgba);
        add(&mut self.depth, &part.depth);
        add(&mut self.normals, &part.normals);
        add(&mut self.ids, &part.ids);
    }

    /// Writes `count` pictures of one size as an endless loop of `all_ms` milliseconds: a GIF if the file's name ends
    /// so, else an animated PNG.
    ///
    /// Pixels of a GIF are transparent or opaque, so without a background it gets a white one; each picture has its own
    /// palette.
    pub(crate) fn write_frames_to<E: From<RenderError>>(
        file: ImageFile,
        [width, height]: [u32; 2],
        count: u32,
        all_ms: u32,
        mut frame: impl FnMut(u32) -> Result<Self, E>,
    ) -> Result<(), E> {
        let mut stopped = None;
        let is_gif = file.path.extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("gif"));
        let mut frame = |number: u32| -> io::Result<Self> {
            frame(number).map_err(|error| {
                stopped = Some(error);
                io::ErrorKind::Interrupted.into()
            })
        };
        let each = |whole: u32| u16::try_from(whole).unwrap_or(u16::MAX);
        let filled = file.fill(|out| {
            if is_gif {
                let mut encoder =
                    gif::Encoder::new(out, each(width), each(height), &[]).map_err(io::Error::other)?;
                encoder.set_repeat(gif::Repeat::Infinite).map_err(io::Error::other)?;
                for number in 0..count {
                    let mut image = frame(number)?;
                    image.lay_on([255; 3]);
                    let mut frame =
                        gif::Frame::from_rgba_speed(each(width), each(height), &mut image.rgba, GIF_SPEED);
                    // Hundredths of a second, which add up to the whole.
                    let until = |number: u32| all_ms / 10 * number / count.max(1);
                    frame.delay = each(until(number + 1) - until(number)).max(MIN_DELAY);
                    encoder.write_frame(&frame).map_err(io::Error::other)?;
                }
                return Ok(());
            }
            let mut encoder = png::Encoder::new(out, width, height);
            encoder.set_color(png::ColorType::Rgba);
            encoder.set_depth(png::BitDepth::Eight);
            encoder.set_compression(png::Compression::Fast);
            encoder.set_filter(png::Filter::Paeth);
            encoder.set_animated(count, 0)?;
            encoder.set_frame_delay(each(all_ms / count.max(1)).max(1), 1000)?;
            encoder.add_text_chunk(KEYWORD.into(), PROGRAM.into())?;
            encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
            let mut writer = encoder.write_header()?;
            for number in 0..count {
                writer.write_image_data(&frame(number)?.rgba)?;
            }
            Ok(writer.finish()?)
        });
        stopped.map_or(Ok(()), Err)?;
        Ok(filled?)
    }
}

/// Fills a vector with `count` copies of an item, reusing its memory.
pub(super) fn refill<T: Copy>(items: &mut Vec<T>, count: usize, item: T) {
    items.clear();
    items.resize(count, item);
}

/// A layer of a picture as a PNG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PngLayer {
    /// Colours.
    Color,
    Depth,
    Normals,
    /// Numbers of boxes.
    Ids,
}

impl PngLayer {
    fn format(self) -> (png::ColorType, png::BitDepth) {
        match self {
            Self::Color => (png::ColorType::Rgba, png::BitDepth::Eight),
            Self::Depth => (png::ColorType::Grayscale, png::BitDepth::Sixteen),
            Self::Normals => (png::ColorType::Rgb, png::BitDepth::Eight),
            Self::Ids => (png::ColorType::Rgb, png::BitDepth::Sixteen),
        }
    }
}

/// The settings of a layer's PNG.
fn encoder<W: Write>(
    out: W,
    layer: PngLayer,
    [width, height]: [u32; 2],
) -> io::Result<png::Encoder<'static, W>> {
    let mut encoder = png::Encoder::new(out, width, height);
    let (color, bits) = layer.format();
    encoder.set_color(color);
    encoder.set_depth(bits);
    if u64::from(width) * u64::from(height) > MAX_SMALL {
        encoder.set_compression(png::Compression::Fast);
        encoder.set_filter(png::Filter::Paeth);
    } else {
        encoder.set_deflate_compression(SMALL_LEVEL);
        encoder.set_filter(png::Filter::Adaptive);
    }
    // It often lies in the folder of its volume, and must not be taken for a slice of it.
    encoder.add_text_chunk(KEYWORD.into(), PROGRAM.into())?;
    if layer == PngLayer::Color {
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    }
    Ok(encoder)
}

/// The error of a file at `path` that cannot be written.
fn unwritable(path: &Path) -> impl Fn(io::Error) -> RenderError {
    move |cause| RenderFault::Write { path: path.to_path_buf(), cause }.into()
}

/// Bytes of compressed pixels written together.
const CHUNK: usize = 64 << 10;

/// A layer on its way into a file, in batches of rows.
pub(crate) struct PngRows {
    layer: PngLayer,
    writer: png::StreamWriter<'static, File>,
    path: PathBuf,
    file: AtomicFile,
}

impl PngRows {
    /// Begins a picture of this size.
    ///
    /// # Errors
    /// [`RenderError`] when the disk refuses.
    pub(crate) fn begin(file: ImageFile, layer: PngLayer, size: [u32; 2]) -> Result<Self, RenderError> {
        let ImageFile { path, file } = file;
        let begin = || -> io::Result<png::StreamWriter<'static, File>> {
            let writer = encoder(file.file().try_clone()?, layer, size)?.write_header()?;
            Ok(writer.into_stream_writer_with_size(CHUNK)?)
        };
        let writer = begin().map_err(unwritable(&path))?;
        Ok(Self { layer, writer, path, file })
    }

    /// Adds the rows of a part of the picture.
    ///
    /// # Errors
    /// [`RenderError`] when the part lacks this layer; else the errors of [`PngRows::begin`].
    pub(crate) fn put(&mut self, part: &Image) -> Result<(), RenderError> {
        let words = |writer: &mut png::StreamWriter<'_, File>, words: &[u16]| {
            words.chunks(CHUNK / 2).try_for_each(|words| {
                let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
                writer.write_all(&bytes)
            })
        };
        let without = |layer| usage!("the picture was made without {layer}; ask for it").into();
        let written = match (self.layer, part) {
            (PngLayer::Color, part) => self.writer.write_all(&part.rgba),
            (PngLayer::Depth, Image { depth: Some(depth), .. }) => words(&mut self.writer, depth),
            (PngLayer::Normals, Image { normals: Some(normals), .. }) => self.writer.write_all(normals),
            (PngLayer::Ids, Image { ids: Some(ids), .. }) => words(&mut self.writer, ids),
            (PngLayer::Depth, _) => return Err(without("depth")),
            (PngLayer::Normals, _) => return Err(without("normals")),
            (PngLayer::Ids, _) => return Err(without("numbers of boxes")),
        };
        written.map_err(unwritable(&self.path))
    }

    /// Moves the file to its place after all rows are written.
    pub(crate) fn finish(self) -> Result<(), RenderError> {
        let Self { writer, path, file, .. } = self;
        let written = writer.finish().map_err(io::Error::from).and_then(|()| file.commit());
        written.map_err(unwritable(&path))
    }
}

/// An image's file before it has its name: failures to write show when it is begun.
#[derive(Debug)]
pub(crate) struct ImageFile {
    path: PathBuf,
    file: AtomicFile,
}

impl ImageFile {
    /// Begins the file that will be at `path`; dropped, it leaves nothing.
    ///
    /// # Errors
    /// [`RenderError`] when the folder is missing or cannot be written, or `path` is a folder or a device.
    pub(crate) fn create(path: &Path) -> Result<Self, RenderError> {
        let file = AtomicFile::create(path).map_err(unwritable(path))?;
        Ok(Self { path: path.to_path_buf(), file })
    }

    /// Writes the bytes and moves the file to its place.
    fn fill(self, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), RenderError> {
        let Self { path, file } = self;
        let write = || -> io::Result<()> {
            let mut out = BufWriter::new(file.file());
            fill(&mut out)?;
            out.flush()?;
            drop(out);
            file.commit()
        };
        write().map_err(unwritable(&path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small() -> Image {
        Image {
            width: 2,
            height: 1,
            rgba: vec![10, 20, 30, 255, 0, 0, 0, 0],
            depth: Some(vec![65535, 0]),
            normals: Some(vec![128, 1, 128, 0, 0, 0]),
            ids: Some(vec![0, 1, 2, 0, 0, 0]),
        }
    }

    fn read(path: &Path) -> (png::ColorType, png::BitDepth, Vec<u8>) {
        let decoder = png::Decoder::new(io::BufReader::new(std::fs::File::open(path).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        bytes.truncate(info.buffer_size());
        (info.color_type, info.bit_depth, bytes)
    }

    #[test]
    fn pictures_are_written_whole_and_replace_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, b"old").unwrap();
        let image = small();
        image.write_png(&path).unwrap();
        assert_eq!(read(&path), (png::ColorType::Rgba, png::BitDepth::Eight, image.rgba.clone()));
        let mut memory = Vec::new();
        image.write_png_to(&mut memory).unwrap();
        assert_eq!(memory, std::fs::read(&path).unwrap());
        assert!(Image { rgba: vec![0; 3], ..image.clone() }.write_png_to(io::sink()).is_err());
        let depth = folder.path().join("d.png");
        image.write_depth_png(&depth).unwrap();
        assert_eq!(read(&depth).2, [255, 255, 0, 0]);
        let normals = folder.path().join("n.png");
        image.write_normals_png(&normals).unwrap();
        assert_eq!(read(&normals).2, [128, 1, 128, 0, 0, 0]);
        let ids = folder.path().join("i.png");
        image.write_ids_png(&ids).unwrap();
        assert_eq!(read(&ids).2, [0, 0, 0, 1, 0, 2, 0, 0, 0, 0, 0, 0]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 4);
    }

    #[test]
    fn failures_name_the_file_and_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let error = small().write_png(folder.path().join("missing/a.png")).unwrap_err().to_string();
        assert!(error.contains("missing/a.png") && error.contains("does not exist"), "{error}");
        // The target is a folder.
        let taken = folder.path().join("taken");
        std::fs::create_dir(&taken).unwrap();
        assert!(small().write_png(&taken).is_err());
        let broken = Image { rgba: vec![0; 3], ..small() };
        assert!(broken.write_png(folder.path().join("b.png")).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let plain = Image { depth: None, ..small() };
        assert!(plain.write_depth_png(folder.path().join("d.png")).is_err());
    }
}
