//! What users expect of the pixels and frames of one file, each behaviour by its number: rescale, sign and
//! width, padding, MONOCHROME1, colour, enhanced and legacy multi-frame. If one fails, voxels get wrong
//! values, or frames wrong places.

use crate::common::frames;
use crate::prelude::*;

use infobyte::source::dicom::{Image, Origin, PaddingAttributes};

use crate::common::frames::geometry_of;

fn bytes16(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A value of VR US or SS with several numbers.
fn us_list(w: &mut Writer, tag: u32, values: &[u16]) {
    w.head(tag, "US", u32::try_from(2 * values.len()).unwrap());
    values.iter().for_each(|v| w.u16(*v));
}

fn fd(w: &mut Writer, syntax: Syntax, tag: u32, value: f64) {
    let bytes = if syntax == Syntax::ExplicitBe { value.to_be_bytes() } else { value.to_le_bytes() };
    w.element(tag, "FD", &bytes);
}

fn ul(w: &mut Writer, tag: u32, value: u32) {
    w.head(tag, "UL", 4);
    w.u32(value);
}

fn obstacle(file: &[u8]) -> String {
    Image::of(&header_of(file)).unwrap_err().to_string()
}

/// An enhanced image of some frames, each with position, rescale, echo time and stack.
fn enhanced(syntax: Syntax, defined: bool, frames: u32, per_frame: u32) -> Vec<u8> {
    let mut w = Writer::with_meta(syntax, syntax.uid());
    image(&mut w, Spec { frames: &frames.to_string(), ..Spec::default() });
    // Of the file itself, and of a sequence that is not a functional group of place: neither may win.
    w.text(0x0020_0032, "DS", "9\\9\\9");
    w.nest(0x5200_9229, defined, |w| {
        w.nest(0x0008_1140, defined, |w| w.text(0x0020_0032, "DS", "7\\7\\7"));
        w.nest(0x0020_9116, defined, |w| w.text(0x0020_0037, "DS", "0\\1\\0\\0\\0\\-1"));
        w.nest(0x0028_9110, defined, |w| {
            w.text(0x0018_0050, "DS", "3");
            w.text(0x0028_0030, "DS", "0.75\\0.5");
        });
        w.nest(0x0028_9145, defined, |w| {
            w.text(0x0028_1052, "DS", "-1024");
            w.text(0x0028_1053, "DS", "1");
        });
    });
    type Item = Box<dyn Fn(&mut Writer)>;
    let items: Vec<Item> = (0..per_frame)
        .map(|i| {
            let item = move |w: &mut Writer| {
                w.nest(0x0020_9111, defined, |w| {
                    w.text(0x0020_9056, "SH", if i % 2 == 0 { "A" } else { "B" });
                    ul(w, 0x0020_9057, i / 2 + 1);
                    ul(w, 0x0020_9128, i + 5);
                    w.us(0x0020_9156, 2);
                });
                w.sequence(
                    0x0020_9113,
                    defined,
                    &[&|w| w.text(0x0020_0032, "DS", &format!("{i}.5\\-1\\2")), &|w| {
                        w.text(0x0020_0032, "DS", "8\\8\\8")
                    }],
                );
                w.nest(0x0018_9114, defined, |w| fd(w, syntax, 0x0018_9082, f64::from(i) + 0.25));
                w.nest(0x0018_9226, defined, |w| w.text(0x0008_9007, "CS", "ORIGINAL\\PRIMARY\\M"));
                if i == 1 {
                    w.nest(0x0028_9145, defined, |w| {
                        w.text(0x0028_1052, "DS", "5");
                        w.text(0x0028_1053, "DS", "2.5");
                    });
                }
            };
            Box::new(item) as Item
        })
        .collect();
    let items: Vec<&dyn Fn(&mut Writer)> = items.iter().map(|item| &**item).collect();
    w.sequence(0x5200_9230, defined, &items);
    w.element(0x7fe0_0010, "OW", &vec![0; 8 * frames as usize]);
    w.bytes
}

#[test]
fn behaviour_11_rescale_of_each_frame() {
    for syntax in Syntax::ALL {
        let frames = geometry_of(&enhanced(syntax, false, 3, 3)).unwrap();
        let rescales: Vec<_> = frames.iter().map(|f| (f.slope.unwrap(), f.intercept.unwrap())).collect();
        assert_eq!(rescales, [(1.0, -1024.0), (2.5, 5.0), (1.0, -1024.0)], "{syntax:?}");
    }
    // Stored values become physical ones in single precision, each frame by its own.
    let image = Image::of(&header_of(&enhanced(Syntax::ExplicitLe, true, 3, 3))).unwrap();
    assert!(image.rescales());
    let mut out = [0, 0, 0, 0, 10, 0, 0xff, 0xff];
    image.layout.widen(&mut out, 2.5, 5.0);
    let physical: Vec<f32> = out.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
    assert_eq!(physical, [30.0, 163_842.5]);
}

#[test]
fn behaviour_12_signedness_and_width() {
    let raw = [0xf123, 0x0fff, 0x0800, 0x7fff];
    for (bits, signed, expected) in [
        // u16 above 32767 survives.
        ([16, 16, 15], false, raw),
        ([16, 16, 15], true, raw),
        ([16, 12, 11], false, [0x0123, 0x0fff, 0x0800, 0x0fff]),
        ([16, 12, 11], true, [0x0123, 0xffff, 0xf800, 0xffff]),
        ([16, 12, 15], false, [0x0f12, 0x00ff, 0x0080, 0x07ff]),
        ([16, 12, 15], true, [0xff12, 0x00ff, 0x0080, 0x07ff]),
    ] {
        let spec = Spec { bits, signed, ..Spec::default() };
        for syntax in Syntax::ALL {
            let mut w = Writer::bare(syntax);
            raw.iter().for_each(|v| w.u16(*v));
            let file = native(syntax, spec, &w.bytes);
            assert_eq!(words(&frames_of(&file).unwrap()[0]), expected, "{syntax:?} {bits:?} {signed}");
        }
        let file = encapsulated(RLE, spec, &[], &[rle16(&raw)]);
        assert_eq!(words(&frames_of(&file).unwrap()[0]), expected, "RLE {bits:?} {signed}");
        let file = deflated(&native(Syntax::ExplicitLe, spec, &bytes16(&raw)), false);
        assert_eq!(words(&frames_of(&file).unwrap()[0]), expected, "deflated {bits:?} {signed}");
        let scalar = if signed { ScalarType::I16 } else { ScalarType::U16 };
        assert_eq!(Image::of(&header_of(&file)).unwrap().layout.scalar(), scalar);
    }
    // 32 bits, compressed as four planes.
    let values = [0xdead_beef_u32, 1, 0x8000_0000, 7];
    let planes: Vec<Vec<u8>> = (0..4).map(|i| values.iter().map(|v| v.to_be_bytes()[i]).collect()).collect();
    let spec = Spec { bits: [32, 32, 31], ..Spec::default() };
    let got = frames_of(&encapsulated(RLE, spec, &[], &[rle(&planes)])).unwrap();
    let got: Vec<u32> = got[0].chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
    assert_eq!(got, values);
    for allocated in [2, 12, 24, 64] {
        let spec = Spec { bits: [allocated, 8, 7], ..Spec::default() };
        let text = obstacle(&native(Syntax::ExplicitLe, spec, &[0; 64]));
        assert_eq!(text, format!("pixels of {allocated} bits allocated cannot be read"));
    }
}

#[test]
fn behaviour_12_bytes_in_big_endian_words_floats_and_bits() {
    // 8-bit pixels, three a row, in big-endian words: neighbours are swapped, also over frames.
    let spec = Spec { size: [3, 1], bits: [8, 8, 7], frames: "3", ..Spec::default() };
    let file = native(Syntax::ExplicitBe, spec, &[2, 1, 4, 3, 6, 5, 8, 7, 0, 9]);
    assert_eq!(frames_of(&file).unwrap(), [[1, 2, 3], [4, 5, 6], [7, 8, 9]]);

    for (tag, width, scalar) in [(0x7fe0_0008, 4, ScalarType::F32), (0x7fe0_0009, 8, ScalarType::F64)] {
        for syntax in Syntax::ALL {
            let mut w = Writer::with_meta(syntax, syntax.uid());
            let bits = 8 * width;
            image(&mut w, Spec { size: [2, 1], bits: [bits, bits, bits - 1], ..Spec::default() });
            let mut pixels = Vec::new();
            for v in [-1.5_f64, 1e30] {
                #[expect(clippy::cast_possible_truncation, reason = "single precision is meant")]
                let mut bytes =
                    if width == 4 { (v as f32).to_le_bytes().to_vec() } else { v.to_le_bytes().to_vec() };
                if syntax == Syntax::ExplicitBe {
                    bytes.reverse();
                }
                pixels.extend(bytes);
            }
            w.element(tag, "OW", &pixels);
            let image = Image::of(&header_of(&w.bytes)).unwrap();
            assert_eq!((image.layout.scalar(), image.rescales()), (scalar, false));
            let got = frames_of(&w.bytes).unwrap().remove(0);
            let got: Vec<f64> = match width {
                4 => got.chunks_exact(4).map(|b| f64::from(bytemuck::pod_read_unaligned::<f32>(b))).collect(),
                _ => got.chunks_exact(8).map(bytemuck::pod_read_unaligned).collect(),
            };
            assert!(got[0] == -1.5 && (got[1] / 1e30 - 1.0).abs() < 1e-6, "{syntax:?} {got:?}");
        }
    }

    // Bits: the first pixel is the lowest, and the second frame begins inside a byte.
    let spec = Spec { size: [5, 1], bits: [1, 1, 0], frames: "3", ..Spec::default() };
    let file = native(Syntax::ExplicitLe, spec, &[0b1011_0010, 0b0100_0001]);
    assert_eq!(Image::of(&header_of(&file)).unwrap().layout.scalar(), ScalarType::U8);
    let expected = [[0, 1, 0, 0, 1], [1, 0, 1, 1, 0], [0, 0, 0, 0, 1]];
    assert_eq!(frames_of(&file).unwrap(), expected);
    assert_eq!(frames_of(&deflated(&file, true)).unwrap(), expected);
    let short = native(Syntax::ExplicitLe, Spec { size: [5, 2], ..spec }, &[0, 0]);
    assert_eq!(obstacle(&short), "the pixels are cut short: 2 bytes of 4");
}

#[test]
fn behaviour_13_padding_becomes_background_before_rescale() {
    let values = [0xf830, 0x0001, 0x0830, 40];
    let spec = Spec { bits: [16, 16, 15], signed: true, ..Spec::default() };
    let unrolled = |file: &[u8]| {
        let header = header_of(file);
        let image = Image::of(&header).unwrap();
        let padding = image.layout.padding(PaddingAttributes::Integer(0xf830, None), -1000.0, 1.0, -24.0);
        let mut collected = Collected { padding, ..Collected::default() };
        unroll(file, Path::new("x"), &header, &image, &Budget::new(MEMORY), &mut collected).unwrap();
        words(&collected.frames[0])
    };
    // -2000 is padding; -1000 HU is stored as -976.
    let expected = [(-976_i16).cast_unsigned(), 1, 0x0830, 40];
    assert_eq!(unrolled(&encapsulated(RLE, spec, &[], &[rle16(&values)])), expected);
    let plain = native(Syntax::ExplicitLe, spec, &bytes16(&values));
    assert_eq!(unrolled(&deflated(&plain, false)), expected);
    let image = Image::of(&header_of(&plain)).unwrap();
    let padding = image.layout.padding(PaddingAttributes::Integer(0xf830, None), -1000.0, 1.0, -24.0);
    let mut cells = bytes16(&values);
    image.layout.decode_padded(&mut cells, padding);
    assert_eq!(words(&cells), expected);
}

#[test]
fn behaviour_14_monochrome1_keeps_its_numbers() {
    let spec = Spec { photometric: "MONOCHROME1", ..Spec::default() };
    let values = [1, 2, 60_000, 4];
    let file = native(Syntax::ExplicitLe, spec, &bytes16(&values));
    assert_eq!(words(&frames_of(&file).unwrap()[0]), values);
    assert_eq!(header_of(&file).photometric, "MONOCHROME1");
    let file = encapsulated(RLE, spec, &[], &[rle16(&values)]);
    assert_eq!(words(&frames_of(&file).unwrap()[0]), values);
}

#[test]
fn behaviour_15_colour_becomes_luminance_or_is_refused() {
    let spec = Spec { size: [3, 2], bits: [8, 8, 7], samples: 3, photometric: "RGB", ..Spec::default() };
    let pixels = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9], [255, 255, 255], [10, 20, 30]];
    let flat: Vec<u8> = pixels.concat();
    let planes: Vec<Vec<u8>> = (0..3).map(|i| pixels.iter().map(|p| p[i]).collect()).collect();
    let expected: Vec<u8> = vec![76, 150, 29, 9, 255, 18];
    let planar = Spec { planar: 1, ..spec };
    let plain = native(Syntax::ExplicitLe, spec, &flat);
    for (what, file) in [
        ("pixels", plain.clone()),
        ("planes", native(Syntax::ExplicitLe, planar, &planes.concat())),
        ("deflated", deflated(&plain, false)),
        ("deflated planes", deflated(&native(Syntax::ExplicitLe, planar, &planes.concat()), false)),
        ("RLE", encapsulated(RLE, planar, &[], &[rle(&planes)])),
        (
            "fragments",
            encapsulated(frames::ENCAPSULATED, planar, &[], &[planes[0].clone(), planes[1..].concat()]),
        ),
    ] {
        assert_eq!(frames_of(&file).unwrap(), [&expected[..]], "{what}");
        let image = Image::of(&header_of(&file)).unwrap();
        assert!(!image.rescales() && image.note().unwrap().to_string().contains("luminance"), "{what}");
        let header = header_of(&file);
        let raw = Image::of_components(&header).unwrap();
        let mut collected = Collected::default();
        unroll(&file[..], Path::new("x"), &header, &raw, &Budget::new(MEMORY), &mut collected).unwrap();
        assert_eq!(collected.frames, [&flat[..]], "{what}");
    }
    // Swapped bytes, planes of odd length.
    let odd = Spec { size: [3, 1], ..planar };
    let swapped: Vec<u8> = [200, 0, 0, 0, 0, 100, 0, 0, 50].to_vec();
    let mut words_of = swapped.clone();
    words_of.push(0);
    words_of.chunks_exact_mut(2).for_each(|pair| pair.reverse());
    let little = frames_of(&native(Syntax::ExplicitLe, odd, &swapped)).unwrap();
    assert_eq!(little, [[60, 0, 64]]);
    assert_eq!(frames_of(&native(Syntax::ExplicitBe, odd, &words_of)).unwrap(), little);

    let sixteen = Spec { size: [1, 1], bits: [16, 16, 15], ..spec };
    let file = native(Syntax::ExplicitLe, sixteen, &bytes16(&[65_535, 65_535, 65_535]));
    assert_eq!(words(&frames_of(&file).unwrap()[0]), [65_535]);

    let full = Spec { photometric: "YBR_FULL", ..spec };
    let ys: Vec<u8> = pixels.iter().map(|p| p[0]).collect();
    assert_eq!(frames_of(&native(Syntax::ExplicitLe, full, &flat)).unwrap(), [&ys[..]]);
    let half = Spec { size: [4, 2], photometric: "YBR_FULL_422", ..spec };
    let file = native(Syntax::ExplicitLe, half, &[1, 2, 99, 98, 3, 4, 97, 96, 5, 6, 95, 94, 7, 8, 93, 92]);
    assert_eq!(frames_of(&file).unwrap(), [[1, 2, 3, 4, 5, 6, 7, 8]]);

    for photometric in ["CMYK", "HSV", "YBR_PARTIAL_420", "MONOCHROME2", "PALETTE COLOR"] {
        let text = obstacle(&native(Syntax::ExplicitLe, Spec { photometric, ..spec }, &flat));
        assert!(text.contains("colour images") && text.contains(photometric), "{text}");
    }
    let signed = native(Syntax::ExplicitLe, Spec { signed: true, ..spec }, &flat);
    assert_eq!(obstacle(&signed), "colour with signed samples cannot be read");
}

/// A palette image with indices 0..4 over entries from 1 on; each entry is `scale` times (8, 4, 2) x index.
fn palette(entry_bits: u16, packed: bool, syntax: Syntax) -> Vec<u8> {
    let mut w = Writer::with_meta(syntax, syntax.uid());
    image(&mut w, Spec { size: [4, 1], bits: [8, 8, 7], photometric: "PALETTE COLOR", ..Spec::default() });
    for i in 0..3 {
        us_list(&mut w, 0x0028_1101 + i, &[3, 1, entry_bits]);
    }
    for i in 0..3_u32 {
        let entries: Vec<u16> = (0..3).map(|entry| (8 >> i) * entry).collect();
        if packed {
            let mut bytes: Vec<u8> = entries.iter().map(|v| u8::try_from(*v).unwrap()).collect();
            bytes.push(0);
            if syntax == Syntax::ExplicitBe {
                bytes.chunks_exact_mut(2).for_each(|pair| pair.reverse());
            }
            w.element(0x0028_1201 + i, "OW", &bytes);
        } else {
            w.head(0x0028_1201 + i, "OW", 6);
            entries.iter().for_each(|v| w.u16(*v));
        }
    }
    w.element(0x7fe0_0010, "OB", &[0, 1, 2, 200]);
    w.bytes
}

#[test]
fn behaviour_15_palettes_become_the_luminance_of_their_entries() {
    // (8, 4, 2) has luminance 4.968, twice of it 9.936; indices outside take the nearest entry.
    let expected = [0, 0, 5, 10];
    for syntax in Syntax::ALL {
        for (bits, packed) in [(8, true), (8, false), (16, false)] {
            let file = palette(bits, packed, syntax);
            assert_eq!(words(&frames_of(&file).unwrap()[0]), expected, "{syntax:?} {bits} {packed}");
        }
    }
    let file = palette(16, false, Syntax::ExplicitLe);
    assert_eq!(words(&frames_of(&deflated(&file, false)).unwrap()[0]), expected);
    let error = frames_of(&palette(16, true, Syntax::ExplicitLe)).unwrap_err();
    assert!(error.contains("a table of 3 entries has 4 bytes"), "{error}");
}

#[test]
fn values_go_through_the_modality_lut() {
    for syntax in Syntax::ALL {
        for defined in [true, false] {
            let mut w = Writer::with_meta(syntax, syntax.uid());
            image(&mut w, Spec { size: [5, 1], bits: [16, 12, 11], signed: true, ..Spec::default() });
            w.text(0x0028_1053, "DS", "3");
            w.nest(0x0028_3000, defined, |w| {
                us_list(w, 0x0028_3002, &[4, (-2_i16).cast_unsigned(), 16]);
                w.head(0x0028_3006, "OW", 8);
                [100, 200, 60_000, 400].into_iter().for_each(|v| w.u16(v));
            });
            w.head(0x7fe0_0010, "OW", 10);
            [-5, -2, 0, 1, 9].into_iter().for_each(|v: i16| w.u16(v.cast_unsigned() & 0x0fff));
            let image = Image::of(&header_of(&w.bytes)).unwrap();
            assert_eq!((image.layout.scalar(), image.rescales()), (ScalarType::U16, false));
            assert_eq!(words(&frames_of(&w.bytes).unwrap()[0]), [100, 100, 60_000, 400, 400]);
        }
    }
}

#[test]
fn behaviour_16_enhanced_frames_by_their_functional_groups() {
    for syntax in Syntax::ALL {
        for defined in [true, false] {
            let file = enhanced(syntax, defined, 4, 4);
            let image = Image::of(&header_of(&file)).unwrap();
            assert_eq!(image.frames, 4);
            assert!(matches!(image.access, Access::Native { frame_bytes: 8, .. }));
            let frames = geometry_of(&file).unwrap();
            assert_eq!(frames.len(), 4);
            for (i, frame) in (0_u32..).zip(&frames) {
                let what = format!("{syntax:?} {defined} {i}");
                assert_eq!(frame.index, i, "{what}");
                assert_eq!(frame.position, Some([f64::from(i) + 0.5, -1.0, 2.0]), "{what}");
                assert_eq!(frame.origin, Origin::Stated, "{what}");
                assert_eq!(frame.orientation, Some([0.0, 1.0, 0.0, 0.0, 0.0, -1.0]), "{what}");
                assert_eq!(frame.pixel_spacing, Some([0.75, 0.5]), "{what}");
                assert_eq!(frame.slice_thickness, Some(3.0), "{what}");
                assert_eq!(frame.stack_id, ["A", "B"][i as usize % 2], "{what}");
                assert_eq!(frame.in_stack_position, Some(i / 2 + 1), "{what}");
                assert_eq!(frame.temporal_position, Some(i32::try_from(i).unwrap() + 5), "{what}");
                assert_eq!(frame.acquisition, Some(2), "{what}");
                assert_eq!(frame.echo_time, Some(f64::from(i) + 0.25), "{what}");
                assert_eq!(frame.frame_type, "ORIGINAL\\PRIMARY\\M", "{what}");
            }
        }
    }
    // Fewer groups than frames: the others get what is said of all; more: they are not told of.
    let frames = geometry_of(&enhanced(Syntax::ExplicitLe, true, 3, 2)).unwrap();
    assert_eq!(frames.len(), 3);
    assert_eq!((frames[2].position, frames[2].echo_time), (Some([9.0; 3]), None));
    assert_eq!(geometry_of(&enhanced(Syntax::ExplicitLe, false, 2, 5)).unwrap().len(), 2);
    // In a deflated file, in one pass forwards.
    let file = deflated(&enhanced(Syntax::ExplicitLe, false, 4, 4), false);
    assert_eq!(geometry_of(&file).unwrap()[3].position, Some([3.5, -1.0, 2.0]));
    // Ended early.
    let file = enhanced(Syntax::ExplicitLe, false, 4, 4);
    let mut told = 0;
    infobyte::source::dicom::visit(&file[..], &header_of(&file), &mut |_| {
        told += 1;
        told < 2
    })
    .unwrap();
    assert_eq!(told, 2);
}

#[test]
fn behaviour_16_groups_written_as_unknown() {
    // A sequence with VR UN is implicit little-endian inside (PS3.5 6.2.2 note 2).
    let mut w = Writer::with_meta(Syntax::ExplicitLe, Syntax::ExplicitLe.uid());
    image(&mut w, Spec { frames: "2", ..Spec::default() });
    let mut inner = Writer::bare(Syntax::ImplicitLe);
    for z in ["1", "4"] {
        let mut item = Writer::bare(Syntax::ImplicitLe);
        item.nest(0x0020_9113, true, |w| {
            w.text(0x0020_0032, "DS", &format!("0\\0\\{z}"));
        });
        inner.element(0xfffe_e000, "", &item.bytes);
    }
    w.element(0x5200_9230, "UN", &inner.bytes);
    w.element(0x7fe0_0010, "OW", &[0; 16]);
    let positions: Vec<_> = geometry_of(&w.bytes).unwrap().iter().map(|f| f.position.unwrap()[2]).collect();
    assert_eq!(positions, [1.0, 4.0]);
}

#[test]
fn behaviour_17_legacy_frames_by_spacing_grid_or_detector() {
    let file = |more: &dyn Fn(&mut Writer)| {
        let mut w = Writer::with_meta(Syntax::ExplicitLe, Syntax::ExplicitLe.uid());
        image(&mut w, Spec { frames: "3", ..Spec::default() });
        w.text(0x0020_0037, "DS", "1\\0\\0\\0\\0\\-1");
        more(&mut w);
        w.element(0x7fe0_0010, "OW", &[0; 24]);
        geometry_of(&w.bytes)
    };
    let places = |frames: &[infobyte::source::dicom::FrameGeometry]| {
        frames.iter().map(|f| f.position.unwrap()).collect::<Vec<_>>()
    };
    // Rows along x, columns down -z: the normal is +y.
    let frames = file(&|w| {
        w.text(0x0018_0088, "DS", "2.5");
        w.text(0x0020_0032, "DS", "1\\2\\3");
    })
    .unwrap();
    assert_eq!(places(&frames), [[1.0, 2.0, 3.0], [1.0, 4.5, 3.0], [1.0, 7.0, 3.0]]);
    assert!(frames.iter().all(|f| f.origin == Origin::Stepped && f.spacing_between == Some(2.5)));
    let frames = file(&|w| {
        w.text(0x0020_0032, "DS", "1\\2\\3");
        w.text(0x3004_000c, "DS", "0\\4\\6.5");
    })
    .unwrap();
    assert_eq!(places(&frames), [[1.0, 2.0, 3.0], [1.0, 6.0, 3.0], [1.0, 8.5, 3.0]]);
    assert!(frames.iter().all(|f| f.origin == Origin::Grid));
    let frames = file(&|w| {
        w.text(0x0020_0032, "DS", "1\\2\\3");
        w.text(0x3004_000c, "DS", "3\\4\\6.5");
    })
    .unwrap();
    // Coordinates along z are for transverse frames alone (PS3.3 C.8.8.3.2).
    assert_eq!(places(&frames), [[1.0, 2.0, 3.0], [1.0, 3.0, 3.0], [1.0, 5.5, 3.0]]);
    let frames = file(&|w| {
        w.text(0x0020_0032, "DS", "1\\2\\3");
        w.text(0x3004_000c, "DS", "0\\4");
    })
    .unwrap();
    let wrong = frames[0].wrong.as_ref().unwrap().to_string();
    assert!(frames.len() == 3 && wrong.contains("or not 3 of them"), "{wrong}");
    // Nuclear medicine states its place with the detector.
    let frames = file(&|w| {
        w.text(0x0018_0088, "DS", "-2");
        w.nest(0x0054_0022, false, |w| {
            w.text(0x0020_0032, "DS", "5\\5\\5");
            w.text(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0");
        });
    })
    .unwrap();
    assert_eq!(places(&frames), [[5.0, 5.0, 5.0], [5.0, 5.0, 3.0], [5.0, 5.0, 1.0]]);
    // Nothing said: the order of frames is all there is.
    let frames = file(&|_| ()).unwrap();
    assert!(frames.len() == 3 && frames.iter().all(|f| f.position.is_none()));
}

#[test]
fn frame_counts_that_are_no_numbers_or_too_many_are_named() {
    for (frames, wanted) in [
        (
            "1A",
            "its Number of Frames (0028,0008) is `1A`, which is not a positive number; correct the header",
        ),
        ("0", "its Number of Frames (0028,0008) is `0`, which is not a positive number; correct the header"),
        (
            "-3",
            "its Number of Frames (0028,0008) is `-3`, which is not a positive number; correct the header",
        ),
        ("2", "the pixels are cut short: 8 bytes of 16"),
        ("4294967295", "the pixels are cut short: 8 bytes of 34359738360"),
    ] {
        let spec = Spec { frames, ..Spec::default() };
        assert_eq!(obstacle(&native(Syntax::ExplicitLe, spec, &[0; 8])), wanted);
    }
    let more = |frames, bytes: &[u8]| {
        obstacle(&native(Syntax::ExplicitLe, Spec { frames, ..Spec::default() }, bytes))
    };
    let stated = "and the pixels of more are there";
    assert_eq!(more("2", &[0; 24]), format!("2 frames are stated, {stated}: 24 bytes of 16"));
    // Of one frame as well.
    assert_eq!(more("1", &[0; 16]), format!("1 frame is stated, {stated}: 16 bytes of 8"));
    let spec = Spec { frames: "4294967295", ..Spec::default() };
    let file = encapsulated(RLE, spec, &[], &[rle16(&[1, 2, 3, 4])]);
    let error = Image::of(&header_of(&file)).unwrap_err().to_string();
    let room =
        error.strip_prefix("4294967295 frames are stated, and the file is too short for more than ").unwrap();
    assert!(room.parse::<u64>().unwrap() < 30, "{error}");
    let mpeg = encapsulated("1.2.840.10008.1.2.4.102", Spec::default(), &[], &[vec![0; 8]]);
    assert!(obstacle(&mpeg).contains("compressed, 1.2.840.10008.1.2.4.102"), "{}", obstacle(&mpeg));
    let cut = encapsulated(JPEG, Spec::default(), &[], &[vec![0xff, 0xd8, 0xff, 0xd9]]);
    let error = frames_of(&cut).unwrap_err();
    assert!(error.starts_with("x.dcm: the compressed image is damaged"), "{error}");
}

#[test]
fn jpeg_xl_is_refused_by_name_with_a_converter() {
    for (tail, name) in
        [("110", "JPEG XL lossless"), ("111", "JPEG XL JPEG recompression"), ("112", "JPEG XL")]
    {
        let uid = format!("1.2.840.10008.1.2.4.{tail}");
        let file = encapsulated(&uid, Spec::default(), &[], &[vec![0xff, 0x0a, 0, 0]]);
        let wanted = format!(
            "compressed pixels ({name}) cannot be read; convert the file first, for example with dcm2dcm of dcm4che"
        );
        assert_eq!(obstacle(&file), wanted);
    }
}

/// Refuses everything.
struct Full;

impl infobyte::source::dicom::FrameSink for Full {
    fn row(&mut self, _: u32, _: u32, _: &[u8]) -> Result<(), SourceError> {
        Err(SourceError::unreadable("scratch", std::io::ErrorKind::StorageFull.into()))
    }
}

#[test]
fn too_little_memory_and_a_full_disk_are_told_apart() {
    let file = encapsulated(RLE, Spec::default(), &[], &[rle16(&[1, 2, 3, 4])]);
    let header = header_of(&file);
    let image = Image::of(&header).unwrap();
    let mut all = Collected::default();
    let error = unroll(&file[..], Path::new("x"), &header, &image, &Budget::new(10), &mut all).unwrap_err();
    assert!(error.minimum_bytes().is_some() && error.to_string().contains("leaves only 10 B"), "{error}");
    assert!(image.unroll_bytes() <= MEMORY);
    let error =
        unroll(&file[..], Path::new("x"), &header, &image, &Budget::new(MEMORY), &mut Full).unwrap_err();
    assert_eq!(error.path(), Some(Path::new("scratch")), "{error}");
    let plain = deflated(&native(Syntax::ExplicitLe, Spec::default(), &[0; 8]), false);
    let header = header_of(&plain);
    let image = Image::of(&header).unwrap();
    let error =
        unroll(&plain[..], Path::new("x"), &header, &image, &Budget::new(MEMORY), &mut Full).unwrap_err();
    assert_eq!(error.path(), Some(Path::new("scratch")), "{error}");
}
