"""The DICOM part of make_studies.py: one series as every syntax, and every odd series that users have.

Needs pydicom 3 with pylibjpeg, pyjpegls, python-gdcm and imagecodecs (scripts/requirements-check.txt).
"""
import copy
import warnings

import gdcm
import imagecodecs
import numpy as np
import pydicom
from pydicom import uid
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.encaps import encapsulate, encapsulate_extended
from pydicom.sequence import Sequence

warnings.filterwarnings("ignore")

CT, MR, PET = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.4", "1.2.840.10008.5.1.4.1.1.128"
ENHANCED_CT, ENHANCED_MR = "1.2.840.10008.5.1.4.1.1.2.1", "1.2.840.10008.5.1.4.1.1.4.1"
RT_DOSE, NM, SR = "1.2.840.10008.5.1.4.1.1.481.2", "1.2.840.10008.5.1.4.1.1.20", "1.2.840.10008.5.1.4.1.1.88.11"
SEGMENTATION, LABEL_MAP = "1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7"
HTJ2K = "1.2.840.10008.1.2.4.201"
ROOT = "1.2.826.0.1.3680043.10.543."
SPACING = (0.75, 0.875, 1.5)


def number(value):
    """A decimal string of at most 16 characters."""
    return format(float(value), ".10g")


def blank(sop, series, instance):
    ds = Dataset()
    ds.SOPClassUID, ds.SOPInstanceUID = sop, f"{ROOT}{series}.{instance}"
    ds.StudyInstanceUID, ds.SeriesInstanceUID = ROOT + "1", f"{ROOT}2.{series}"
    ds.PatientName, ds.PatientID = "Nobody^Test", "0"
    ds.StudyDate, ds.StudyTime = "20200101", "120000"
    ds.Modality = {CT: "CT", ENHANCED_CT: "CT", PET: "PT", RT_DOSE: "RTDOSE", NM: "NM", SR: "SR"}.get(sop, "MR")
    ds.SeriesNumber, ds.InstanceNumber = series, instance
    return ds


def put_pixels(ds, stored, bits=16, used=None, signed=False):
    """Describes and stores pixels; `stored` has the bits that go to the file."""
    ds.Rows, ds.Columns = stored.shape[-2:]
    ds.SamplesPerPixel, ds.PhotometricInterpretation = 1, "MONOCHROME2"
    ds.BitsAllocated, ds.BitsStored = bits, used or bits
    ds.HighBit, ds.PixelRepresentation = ds.BitsStored - 1, int(signed)
    ds.PixelData = np.ascontiguousarray(stored).astype(f"<{'i' if signed else 'u'}{bits // 8}").tobytes()
    if len(ds.PixelData) % 2:
        ds.PixelData += b"\0"


def place(ds, affine, z):
    """Position, orientation and spacing of slice z of an affine whose axes have SPACING."""
    for_row, for_column = affine[:, 0] / SPACING[0], affine[:, 1] / SPACING[1]
    ds.ImageOrientationPatient = [number(v) for v in (*for_row, *for_column)]
    ds.ImagePositionPatient = [number(v) for v in affine[:, 3] + z * affine[:, 2]]
    ds.PixelSpacing = [number(SPACING[1]), number(SPACING[0])]
    ds.SliceThickness = "2"


def meta(ds, syntax):
    ds.file_meta = FileMetaDataset()
    ds.file_meta.MediaStorageSOPClassUID, ds.file_meta.MediaStorageSOPInstanceUID = ds.SOPClassUID, ds.SOPInstanceUID
    ds.file_meta.TransferSyntaxUID = syntax


def save(ds, path, syntax=uid.ExplicitVRLittleEndian):
    """Writes a dataset with native pixels in a native syntax."""
    ds = copy.deepcopy(ds)
    meta(ds, syntax)
    if syntax == uid.ExplicitVRBigEndian and "PixelData" in ds and ds.BitsAllocated > 8:
        ds.PixelData = np.frombuffer(ds.PixelData, f"<u{ds.BitsAllocated // 8}").byteswap().tobytes()
    if "PixelData" in ds:
        ds["PixelData"].VR = "OW" if ds.BitsAllocated > 8 else "OB"
    ds.save_as(path, implicit_vr=syntax == uid.ImplicitVRLittleEndian, enforce_file_format=True,
               little_endian=syntax != uid.ExplicitVRBigEndian)


def save_encapsulated(ds, path, syntax, frames, *, offsets="basic", parts=1):
    """Writes frames that are encoded already."""
    ds = copy.deepcopy(ds)
    meta(ds, syntax)
    if offsets == "extended":
        ds.PixelData, ds.ExtendedOffsetTable, ds.ExtendedOffsetTableLengths = encapsulate_extended(frames)
    else:
        ds.PixelData = encapsulate(frames, fragments_per_frame=parts, has_bot=offsets == "basic")
    ds["PixelData"].VR, ds["PixelData"].is_undefined_length = "OB", True
    ds.save_as(path, enforce_file_format=True)


def rle(image):
    """RLE of one frame, byte planes from the highest (PS3.5 annex G)."""
    planes = [np.frombuffer(image.astype(f">u{image.dtype.itemsize}").tobytes(), np.uint8)
              .reshape(*image.shape, -1)[..., k] for k in range(image.dtype.itemsize)]
    segments = []
    for plane in planes:
        out = b""
        for row in plane:
            row = row.tobytes()
            at = 0
            while at < len(row):
                run = 1
                while at + run < len(row) and run < 128 and row[at + run] == row[at]:
                    run += 1
                if run > 2:
                    out += bytes([257 - run, row[at]])
                    at += run
                    continue
                end = at + 1
                while end < len(row) and end - at < 128 and not (row[end:end + 3] == row[end:end + 1] * 3):
                    end += 1
                out += bytes([end - at - 1]) + row[at:end]
                at = end
        segments.append(out + (b"\0" if len(out) % 2 else b""))
    head, at = [len(segments)], 64
    for segment in segments:
        head.append(at)
        at += len(segment)
    return np.array(head + [0] * (16 - len(head)), "<u4").tobytes() + b"".join(segments)


class DicomStudies:
    """Writes below OUT/dicom."""

    def __init__(self, studies, iso):
        self.s, self.iso, self.series = studies, iso, 0
        self.base = studies.base
        self.count = len(self.base)

    def slices(self, values=None, affine=None, sop=CT, series=None, intercept=-1024, **pixels):
        """Datasets of a plain series in order of position; stored = value - intercept."""
        values = self.base if values is None else values
        affine = self.s.affine if affine is None else affine
        if series is None:
            self.series += 1
        made = []
        for z, image in enumerate(values):
            ds = blank(sop, series or self.series, z + 1)
            ds.ImageType = ["ORIGINAL", "PRIMARY", "AXIAL"]
            place(ds, affine, z)
            put_pixels(ds, image.astype(int) - intercept, **pixels)
            ds.RescaleSlope, ds.RescaleIntercept = "1", str(intercept)
            made.append(ds)
        return made

    def write_series(self, name, made, syntax=uid.ExplicitVRLittleEndian, names=None):
        folder = self.s.folder("dicom/" + name)
        for i, ds in enumerate(made):
            save(ds, folder / (names(i) if names else f"{i + 1:03d}.dcm"), syntax)
        return folder

    def truth(self, name, values=None, affine="base", **more):
        """Truth of a study below dicom/; values and affine of the object unless stated."""
        values = self.base.astype(float) if values is None else values
        self.s.add("dicom/" + name, values, self.s.affine if isinstance(affine, str) else affine,
                   **{"same": "base", **more})

    def write(self):
        self.syntaxes()
        self.geometry()
        self.several()
        self.pixels()
        self.headers()
        self.frames()

    def syntaxes(self):
        for name, syntax in (("explicit-le", uid.ExplicitVRLittleEndian), ("implicit-le", uid.ImplicitVRLittleEndian),
                             ("explicit-be", uid.ExplicitVRBigEndian),
                             ("deflated", uid.DeflatedExplicitVRLittleEndian)):
            self.write_series("syntax-" + name, self.slices(), syntax)
            self.truth("syntax-" + name)
        own = {"rle": (uid.RLELossless, rle),
               "jpegls-80": (uid.JPEGLSLossless, imagecodecs.jpegls_encode),
               "jpegls-81-lossless": (uid.JPEGLSNearLossless, imagecodecs.jpegls_encode),
               "j2k-90": (uid.JPEG2000Lossless, lambda a: imagecodecs.jpeg2k_encode(a, codecformat="j2k", level=0,
                                                                                    reversible=True)),
               "j2k-91-reversible": (uid.JPEG2000, lambda a: imagecodecs.jpeg2k_encode(
                   a, codecformat="j2k", level=0, reversible=True)),
               "htj2k-201": (uid.UID(HTJ2K), lambda a: imagecodecs.htj2k_encode(a, reversible=True))}
        for name, (syntax, encode) in own.items():
            folder = self.s.folder(f"dicom/syntax-{name}")
            try:
                for z, ds in enumerate(self.slices()):
                    image = np.frombuffer(ds.PixelData, "<u2").reshape(ds.Rows, ds.Columns)
                    save_encapsulated(ds, folder / f"{z + 1:03d}.dcm", syntax, [bytes(encode(image))])
            except Exception as error:
                print(f"syntax-{name}: left out, the encoder says: {error}")
                continue
            self.truth("syntax-" + name, expect="either" if "htj2k" in name else "converts", reason="HTJ2K|High|syntax")
        for name, syntax in (("jpeg-lossless-57", gdcm.TransferSyntax.JPEGLosslessProcess14),
                             ("jpeg-lossless-70", gdcm.TransferSyntax.JPEGLosslessProcess14_1)):
            plain = self.write_series("syntax-" + name, self.slices())
            for path in sorted(plain.iterdir()):
                reader = gdcm.ImageReader()
                reader.SetFileName(str(path))
                assert reader.Read()
                change = gdcm.ImageChangeTransferSyntax()
                change.SetTransferSyntax(gdcm.TransferSyntax(syntax))
                change.SetInput(reader.GetImage())
                assert change.Change(), name
                writer = gdcm.ImageWriter()
                writer.SetFileName(str(path))
                writer.SetFile(reader.GetFile())
                writer.SetImage(change.GetOutput())
                assert writer.Write()
            self.truth("syntax-" + name)
        # Lossy: what the reference decoder makes of them; others may round otherwise.
        small = [np.clip(v // 10 + 100, 0, 255).astype(np.uint8) for v in self.base]
        lifted = [(v.astype(int) + 1024).astype(np.uint16) for v in self.base]
        for name, syntax, images, bits, encode, decode, lossy in (
                ("jpeg-baseline-50", uid.JPEGBaseline8Bit, small, 8, lambda a: imagecodecs.jpeg8_encode(a, level=95),
                 imagecodecs.jpeg8_decode, 0.03),
                ("jpeg-extended-51", uid.JPEGExtended12Bit, lifted, 12,
                 lambda a: imagecodecs.jpeg8_encode(a, level=95, bitspersample=12), imagecodecs.jpeg8_decode, 0.03),
                ("jpegls-81-near-2", uid.JPEGLSNearLossless, lifted, 16,
                 lambda a: imagecodecs.jpegls_encode(a, level=2), imagecodecs.jpegls_decode, 0.0),
                ("j2k-91-lossy", uid.JPEG2000, lifted, 16, lambda a: imagecodecs.jpeg2k_encode(
                    a, codecformat="j2k", level=60, reversible=False), imagecodecs.jpeg2k_decode, 0.03)):
            folder, decoded = self.s.folder(f"dicom/syntax-{name}"), []
            intercept = 0 if bits == 8 else -1024
            for z, ds in enumerate(self.slices()):
                coded = bytes(encode(images[z]))
                decoded.append(np.asarray(decode(coded)).astype(float) + intercept)
                put_pixels(ds, images[z], bits=8 if bits == 8 else 16, used=bits)
                ds.RescaleIntercept = str(intercept)
                save_encapsulated(ds, folder / f"{z + 1:03d}.dcm", syntax, [coded])
            self.truth("syntax-" + name, np.stack(decoded), iso=120.0 if bits == 8 else self.iso, same=None,
                       lossy=lossy)
        # Signed pixels, where codecs know no sign.
        signed = lambda: self.slices(intercept=0, signed=True)
        for name in ("rle", "jpegls-80"):
            syntax, encode = own[name]
            folder = self.s.folder(f"dicom/signed-{name}")
            for z, ds in enumerate(signed()):
                image = np.frombuffer(ds.PixelData, "<u2").reshape(ds.Rows, ds.Columns)
                save_encapsulated(ds, folder / f"{z + 1:03d}.dcm", syntax, [bytes(encode(image))])
            self.truth("signed-" + name)
        folder = self.s.folder("dicom/signed-j2k-90")
        for z, ds in enumerate(signed()):
            image = np.frombuffer(ds.PixelData, "<i2").reshape(ds.Rows, ds.Columns)
            save_encapsulated(ds, folder / f"{z + 1:03d}.dcm", uid.JPEG2000Lossless, [own["j2k-90"][1](image)])
        self.truth("signed-j2k-90")

    def geometry(self):
        tilted, turned = self.s.sheared(), self.s.oblique()
        self.write_series("gantry-tilt", self.slices(affine=tilted))
        self.truth("gantry-tilt", warn="tilt", affine=tilted, same="tilt")
        self.write_series("oblique", self.slices(affine=turned))
        self.truth("oblique", affine=turned, same="structure:base")
        sagittal = np.array([[0, 0, 1.5, -20.0], [0.75, 0, 0, -15.5], [0, -0.875, 0, 40.25]])
        sagittal[:, 2] *= -1  # x cross y = (0,1,0) x (0,0,-1) = (-1,0,0)
        self.write_series("sagittal", self.slices(affine=sagittal))
        self.truth("sagittal", affine=sagittal)
        down = np.array([[0.75, 0, 0, -20.0], [0, -0.875, 0, 15.5], [0, 0, -1.5, 40.25]])
        self.write_series("normal-down", self.slices(affine=down))
        self.truth("normal-down", affine=down, note="rows run to anterior, so the normal points to the feet")
        prone = np.array([[-0.75, 0, 0, 20.0], [0, -0.875, 0, 15.5], [0, 0, 1.5, -40.25]])
        self.write_series("prone", self.slices(affine=prone))
        self.truth("prone", affine=prone)
        single = self.slices()[18]
        single.private_block(0x0029, "TEST", create=True).add_new(1, "OB", b"x" * 1000000)
        save(single, self.s.path("dicom/single.dcm"))
        lone = self.s.affine.copy()
        lone[2, 3] += 18 * 1.5
        lone[2, 2] = 2.0  # no neighbour: the stated thickness
        self.truth("single.dcm", self.base[18:19].astype(float), warn="one slice|single", affine=lone, same=None,
                   note="one slice, behind a megabyte of private data")
        for name, change in (
                ("x-orientation-differs", lambda ds: setattr(ds, "ImageOrientationPatient", [1, 0, 0, 0, 0.8, 0.6])),
                ("x-spacing-differs", lambda ds: setattr(ds, "PixelSpacing", ["0.875", "0.8"]))):
            odd = self.slices()
            change(odd[20])
            self.write_series(name, odd)
            self.truth(name, expect="refused", reason="orientation|pixel spacing|differ|not used|other sets?")
        backward = self.slices()[::-1]
        for i, ds in enumerate(backward):
            ds.InstanceNumber = i + 1
        self.write_series("order-backward", backward)
        self.truth("order-backward", note="file names and instance numbers run against the positions")
        mixed = self.slices()
        order = self.s.rng.permutation(self.count)
        for i, ds in enumerate(mixed):
            ds.InstanceNumber, ds.SliceLocation = int(order[i]), str(-i)
        names = self.s.rng.permutation(self.count)
        self.write_series("order-shuffled", mixed, names=lambda i: f"IMG{names[i]}")
        self.truth("order-shuffled", note="no file extensions; names, numbers and locations say nothing")
        nameless = self.slices()
        for ds in nameless:
            del ds.InstanceNumber
        self.write_series("no-instance-numbers", nameless[::-1])
        self.truth("no-instance-numbers")
        jitter = self.slices()
        for z, ds in enumerate(jitter[1:-1], 1):
            ds.ImagePositionPatient[2] = number(30.0 + 1.5 * z + (1e-4 if z % 2 else -1e-4))
        self.write_series("jitter", jitter)
        self.truth("jitter", tolerance=2e-3, note="positions rounded by the scanner")
        self.write_series("x-missing-slice", [d for z, d in enumerate(self.slices()) if z != 17])
        self.truth("x-missing-slice", expect="refused", reason="missing|gap|uneven")
        self.truth("x-missing-slice#fill", warn="missing|fill|gap", geometry_only=True,
                   options=["--gaps", "fill"], same=None)
        kept = self.s.affine.copy()
        kept[:, 2] *= (self.count - 1) / (self.count - 2)
        self.truth("x-missing-slice#keep", np.delete(self.base, 17, 0).astype(float), affine=kept, same=None,
                   options=["--gaps", "keep"], warn="missing|keep|gap|uneven")
        self.write_series("x-two-gaps", [d for z, d in enumerate(self.slices()) if z not in (5, 6, 20)])
        self.truth("x-two-gaps", expect="refused", reason="missing|gap|uneven")
        flat = self.slices()
        for ds in flat:
            ds.ImagePositionPatient = flat[0].ImagePositionPatient
        self.write_series("x-same-position", flat)
        self.truth("x-same-position", expect="refused", reason="one position|same position")
        bare = self.slices()
        for ds in bare:
            del ds.ImagePositionPatient, ds.ImageOrientationPatient
            ds.SpacingBetweenSlices = "1.5"
        self.write_series("no-positions", bare)
        self.truth("no-positions", warn="position", origin=False, note="order by instance number, with a warning")

    def several(self):
        folder = self.write_series("duplicate-identical", self.slices())
        (folder / "copy.dcm").write_bytes((folder / "011.dcm").read_bytes())
        self.truth("duplicate-identical", warn="duplicate|twice|cop(y|ies)|same",
                   note="the same file twice under two names")
        other = self.slices()
        twice = copy.deepcopy(other[10])
        twice.SOPInstanceUID += ".9"
        twice.PixelData = twice.PixelData[::-1]
        self.write_series("x-duplicate-different", [*other, twice])
        self.truth("x-duplicate-different", expect="refused", reason="position|repeat|duplicate")
        half = (self.base // 2).astype(np.int16)

        def pair(name, change, sop=MR):
            series = self.series = self.series + 1
            first, second = (self.slices(v, series=series, sop=sop, intercept=-1024) for v in (self.base, half))
            for i, ds in enumerate(second):
                ds.SOPInstanceUID += ".2"
                ds.InstanceNumber = 100 + i
            for which, part in ((0, first), (1, second)):
                for ds in part:
                    change(ds, which)
            self.write_series(name, [d for both in zip(first, second) for d in both])
            self.truth(name, warn="not used|sets|volumes", others=[(half.astype(float), self.s.affine)], same=None)

        def magnitude_phase(ds, which):
            ds.ImageType = ["ORIGINAL", "PRIMARY", "P" if which else "M", "ND"]

        def echo(ds, which):
            ds.EchoTime, ds.EchoNumbers = str(10 * (which + 1)), which + 1

        def acquisition(ds, which):
            ds.AcquisitionNumber = which + 1

        def phase(ds, which):
            ds.TemporalPositionIdentifier, ds.TriggerTime = which + 1, str(50 * which)

        pair("two-magnitude-phase", magnitude_phase)
        pair("two-echoes", echo)
        pair("two-acquisitions", acquisition, CT)
        pair("two-phases", phase)
        made = self.slices()
        series = self.series
        scout = blank(CT, series, 99)
        scout.ImageType = ["ORIGINAL", "PRIMARY", "LOCALIZER"]
        scout.ImageOrientationPatient, scout.ImagePositionPatient = [0, 1, 0, 0, 0, -1], [0, -50, 100]
        scout.PixelSpacing, scout.RescaleSlope, scout.RescaleIntercept = ["1", "1"], "1", "-1024"
        put_pixels(scout, np.full((50, 60), 900))
        self.write_series("with-localizer", [scout, *made])
        self.truth("with-localizer", warn="localizer|not used|left out", note="an overview picture in the same series")
        large, small = self.slices(), self.slices(self.base[:9, :20, :30])
        folder = self.write_series("two-series", [*small, *large])
        self.truth("two-series", warn="not used|largest", note="the larger one")
        folder = self.write_series("with-others", self.slices())
        report = blank(SR, 900, 1)
        save(report, folder / "report.dcm")
        (folder / "notes.txt").write_text("not an image\n")
        (folder / "empty").write_bytes(b"")
        self.truth("with-others", warn="left out", note="a report, a text and an empty file beside the images")
        folder = self.write_series("x-one-cut-short", self.slices())
        body = (folder / "020.dcm").read_bytes()
        (folder / "020.dcm").write_bytes(body[:-700])
        self.truth("x-one-cut-short", expect="refused", reason="020|cut short|missing|gap")

    def pixels(self):
        """Bits, signs, rescale, padding, colour."""
        base = self.base
        self.write_series("signed", self.slices(intercept=0, signed=True))
        self.truth("signed")
        garbage = self.slices()
        clipped = np.clip(base.astype(int) + 1024, 0, 4095)
        for z, ds in enumerate(garbage):
            high = self.s.rng.integers(0, 16, clipped[z].shape) << 12
            put_pixels(ds, clipped[z] | high, used=12)
        self.write_series("bits-12-garbage", garbage)
        self.truth("bits-12-garbage", note="the four high bits are no part of the value")
        negative = self.slices(intercept=0)
        for z, ds in enumerate(negative):
            high = self.s.rng.integers(0, 16, clipped[z].shape) << 12
            put_pixels(ds, (base[z].astype(int) & 0xFFF) | high, used=12)
            ds.PixelRepresentation = 1
        self.write_series("bits-12-signed-garbage", negative)
        self.truth("bits-12-signed-garbage")
        shifted = self.slices()
        for z, ds in enumerate(shifted):
            put_pixels(ds, clipped[z] << 4 | self.s.rng.integers(0, 16, clipped[z].shape), used=12)
            ds.HighBit = 15
        self.write_series("bits-high-15", shifted)
        self.truth("bits-high-15", expect="either", reason="[Hh]igh [Bb]it|bit")
        self.write_series("wide-u16", self.slices(intercept=-40000))
        self.truth("wide-u16", note="stored values over 32767")
        small = np.clip(base // 10 + 100, 0, 255).astype(int)
        self.write_series("bits-8", self.slices(small, intercept=0, bits=8))
        self.truth("bits-8", small.astype(float), iso=120.0, same=None)
        odd = small[:, :39, :47]
        self.write_series("bits-8-odd", self.slices(odd, intercept=0, bits=8))
        self.truth("bits-8-odd", odd.astype(float), iso=120.0, same=None, note="an odd number of pixels")
        self.write_series("bits-32", self.slices(intercept=-40000, bits=32))
        self.truth("bits-32", expect="either", reason="32|bits")
        halves = self.slices()
        for ds in halves:
            ds.RescaleSlope, ds.RescaleIntercept = "0.5", "-512"
        self.write_series("rescale-half", halves)
        self.truth("rescale-half", base / 2.0, iso=100.0, same="base")
        falling = self.slices(-base.astype(int), intercept=-2000)
        for ds in falling:
            ds.RescaleSlope, ds.RescaleIntercept = "-1", "2000"
        self.write_series("rescale-negative", falling)
        self.truth("rescale-negative", same="structure:base", note="stored values fall as physical ones rise")
        flat = self.slices()
        for ds in flat:
            ds.RescaleSlope = "0"
        self.write_series("x-rescale-zero", flat)
        self.truth("x-rescale-zero", expect="refused", reason="slope")
        folder = self.s.folder("dicom/bits-8-ow-big-endian")
        for z, ds in enumerate(self.slices(small, intercept=0, bits=8)):
            ds.PixelData = np.frombuffer(ds.PixelData, "<u2").byteswap().tobytes()
            meta(ds, uid.ExplicitVRBigEndian)
            ds["PixelData"].VR = "OW"
            ds.save_as(folder / f"{z + 1:03d}.dcm", implicit_vr=False, little_endian=False, enforce_file_format=True)
        self.truth("bits-8-ow-big-endian", small.astype(float), iso=120.0, same=None,
                   expect="either", reason="big-endian", note="8-bit pixels in big-endian words lie in swapped pairs")
        slopes = 0.25 + 0.125 * (np.arange(self.count) % 5)
        stored = np.clip(np.rint((base.astype(float) + 1000) / slopes[:, None, None]), 0, 32767).astype(int)
        pet = self.slices(sop=PET)
        for z, ds in enumerate(pet):
            put_pixels(ds, stored[z], signed=True)
            ds.RescaleSlope, ds.RescaleIntercept = number(slopes[z]), "0"
        self.write_series("pet-slopes", pet)
        self.truth("pet-slopes", stored * slopes[:, None, None], iso=1200.0, same=None)
        part = self.slices()
        for ds in part[::3]:
            del ds.RescaleSlope, ds.RescaleIntercept
        self.write_series("x-rescale-missing-on-some", part)
        mixed = base.astype(float)
        mixed[::3] += 1024
        self.truth("x-rescale-missing-on-some", mixed, warn="[Rr]escale", expect="either",
                   reason="[Rr]escale|slope", same=None, note="must be reported at least")
        inverted = self.slices()
        for ds in inverted:
            ds.PhotometricInterpretation = "MONOCHROME1"
        self.write_series("monochrome1", inverted)
        self.truth("monochrome1", note="numbers are kept; only a display inverts them")
        z, y, x = np.meshgrid(*map(np.arange, base.shape), indexing="ij")
        outside = (x - 23.5) ** 2 / 24**2 + (y - 19.5) ** 2 / 20**2 > 1
        for name, fill, limit in (("padding-value", -2000, None), ("padding-range", None, -1800)):
            values = base.astype(int).copy()
            ramp = -2000 + (x + y + z) % 200
            values[outside] = fill if fill else ramp[outside]
            padded = self.slices(values, intercept=0, signed=True)
            for ds in padded:
                ds.add_new("PixelPaddingValue", "SS", -2000)
                if limit:
                    ds.add_new("PixelPaddingRangeLimit", "SS", limit)
            self.write_series(name, padded)
            mended = np.where(outside, -1000, base).astype(float)
            self.truth(name, mended, same="padded")
        self.write_series("padding-range-implicit", padded, uid.ImplicitVRLittleEndian)
        self.truth("padding-range-implicit", mended, same="padded")
        padded = self.slices(np.where(outside, -2000, base), intercept=0, signed=True)
        for ds in padded:
            ds.add_new("PixelPaddingValue", "US", 63536)
        self.write_series("padding-wrong-sign", padded)
        self.truth("padding-wrong-sign", mended, same="padded", note="-2000 stated as unsigned 63536")
        padded = self.slices(np.where(outside, 3000, base), sop=MR)
        for ds in padded:
            ds.add_new("PixelPaddingValue", "US", 4024)
        self.write_series("padding-mr", padded)
        self.truth("padding-mr", np.where(outside, 0, base).astype(float), same=None, note="0 outside of CT")
        padded = self.slices(np.where(outside, -1024, base))
        for ds in padded:
            ds.add_new("PixelPaddingValue", "US", 0)
        self.write_series("padding-unsigned", padded)
        self.truth("padding-unsigned", np.where(outside, -1000, base).astype(float), same="padded")
        # Colours whose luminance (ITU-R BT.601) is not any of the three.
        colour, grey = self.slices()[8:20], []
        for z, ds in enumerate(colour, 8):
            red, green, blue = small[z], 255 - small[z] // 2, (small[z] * 3 + 20 * z) % 256
            grey.append((299 * red + 587 * green + 114 * blue + 500) // 1000)
            put_pixels(ds, red, bits=8)
            ds.SamplesPerPixel, ds.PhotometricInterpretation, ds.PlanarConfiguration = 3, "RGB", 0
            ds.PixelData = np.stack([red, green, blue], -1).astype(np.uint8).tobytes()
            ds.RescaleIntercept = "0"
        self.write_series("x-rgb", colour)
        grey = np.stack(grey).astype(float)
        moved = self.s.affine.copy()
        moved[:, 3] += 8 * moved[:, 2]
        self.truth("x-rgb", grey, affine=moved, warn="colou?r|RGB|luminance", expect="either",
                   reason="colou?r|RGB|samples", iso=180.0, same=None)
        # A curve that rises, with values on both sides of the table.
        first, table = 300, (np.arange(2000) ** 2 // 128 + 7).astype("<u2")
        lut = self.slices()
        for ds in lut:
            item = Dataset()
            item.LUTDescriptor, item.ModalityLUTType = [len(table), first, 16], "US"
            item.add_new("LUTData", "OW", table.tobytes())
            ds.ModalityLUTSequence = Sequence([item])
            del ds.RescaleSlope, ds.RescaleIntercept
        self.write_series("x-modality-lut", lut)
        mapped = table[np.clip(base.astype(int) + 1024 - first, 0, len(table) - 1)].astype(float)
        assert mapped.min() == table[0] and mapped.max() == table[-1]
        self.truth("x-modality-lut", mapped, iso=float(table[1224 - first]), warn="LUT", expect="either", reason="LUT",
                   same=None)

    def headers(self):
        """Files without preamble, meta header or known lengths."""
        folder = self.write_series("no-preamble", self.slices())
        for path in folder.iterdir():
            path.write_bytes(path.read_bytes()[132:])
        self.truth("no-preamble", note="a meta header without preamble and DICM")
        for name, syntax in (("no-meta-implicit", uid.ImplicitVRLittleEndian),
                             ("no-meta-explicit", uid.ExplicitVRLittleEndian)):
            folder = self.s.folder("dicom/" + name)
            for z, ds in enumerate(self.slices()):
                ds["PixelData"].VR = "OW"
                pydicom.dcmwrite(folder / f"{z + 1:03d}", ds, implicit_vr=syntax == uid.ImplicitVRLittleEndian,
                                 little_endian=True, enforce_file_format=False)
            self.truth(name, note="the bare data set")
        trailing = self.slices()
        for ds in trailing:
            ds.DataSetTrailingPadding = b"\0" * 200
        self.write_series("trailing-padding", trailing)
        self.truth("trailing-padding", note="an element after the pixels")
        nested = self.slices()
        for ds in nested:
            inner = Dataset()
            inner.ImagePositionPatient, inner.Rows = [9, 9, 9], 7
            inner.PixelSpacing = ["9", "9"]
            icon = Dataset()
            put_pixels(icon, np.zeros((4, 4)), bits=8)
            ds.IconImageSequence = Sequence([icon])
            outer = Dataset()
            outer.ReferencedImageSequence = Sequence([inner])
            ds.SourceImageSequence = Sequence([outer])
            for element in (ds["IconImageSequence"], ds["SourceImageSequence"], outer["ReferencedImageSequence"]):
                element.is_undefined_length = True
            for item in (outer, inner, icon):
                item.is_undefined_length_sequence_item = True
            ds.private_block(0x0029, "TEST", create=True).add_new(1, "UN", b"x" * 333 + b"y")
        for name, syntax in (("nested", uid.ExplicitVRLittleEndian), ("nested-implicit", uid.ImplicitVRLittleEndian)):
            self.write_series(name, nested, syntax)
            self.truth(name, note="an icon with pixels, and positions inside sequences of undefined length")

    def frames(self):
        """Many frames in one file."""
        base, affine, count = self.base, self.s.affine, self.count
        order = self.s.rng.permutation(count)

        def measures(spaced=True):
            item = Dataset()
            item.PixelSpacing, item.SliceThickness = [number(SPACING[1]), number(SPACING[0])], "2"
            if spaced:
                item.SpacingBetweenSlices = "1.5"
            return Sequence([item])

        def sequence(**attributes):
            item = Dataset()
            for key, value in attributes.items():
                setattr(item, key, value)
            return Sequence([item])

        def enhanced(sop, order, values=base, slopes=None, mat=affine, all_per_frame=False):
            self.series += 1
            ds = blank(sop, self.series, 1)
            ds.ImageType = ["ORIGINAL", "PRIMARY", "VOLUME", "NONE"]
            ds.NumberOfFrames = len(order)
            shared, frames = Dataset(), []
            orientation = [number(v) for v in (*(mat[:, 0] / SPACING[0]), *(mat[:, 1] / SPACING[1]))]
            stored = values.astype(int) + 1024 if slopes is None else values
            put_pixels(ds, stored[order])
            if not all_per_frame:
                shared.PixelMeasuresSequence = measures()
                shared.PlaneOrientationSequence = sequence(ImageOrientationPatient=orientation)
                if slopes is None:
                    shared.PixelValueTransformationSequence = sequence(RescaleSlope="1", RescaleIntercept="-1024",
                                                                       RescaleType="HU")
            for z in order:
                frame = Dataset()
                frame.FrameContentSequence = sequence(StackID="1", InStackPositionNumber=1,
                                                      DimensionIndexValues=[1, int(count - z)])
                frame.PlanePositionSequence = sequence(
                    ImagePositionPatient=[number(v) for v in mat[:, 3] + z * mat[:, 2]])
                if all_per_frame:
                    frame.PixelMeasuresSequence = measures(False)
                    frame.PlaneOrientationSequence = sequence(ImageOrientationPatient=orientation)
                if all_per_frame or slopes is not None:
                    frame.PixelValueTransformationSequence = sequence(
                        RescaleSlope="1" if slopes is None else number(slopes[z]),
                        RescaleIntercept="-1024" if slopes is None else "0", RescaleType="US")
                frames.append(frame)
            ds.SharedFunctionalGroupsSequence = Sequence([shared])
            ds.PerFrameFunctionalGroupsSequence = Sequence(frames)
            return ds

        def one(name, ds, syntax=uid.ExplicitVRLittleEndian, **truth):
            save(ds, self.s.path(f"dicom/{name}.dcm"), syntax)
            self.truth(f"{name}.dcm", **truth)

        straight = np.arange(count)
        one("enhanced-ct", enhanced(ENHANCED_CT, straight))
        one("enhanced-ct-shuffled", enhanced(ENHANCED_CT, order), note="frames out of order, index values wrong")
        one("enhanced-ct-per-frame", enhanced(ENHANCED_CT, order, all_per_frame=True), note="nothing is shared")
        one("enhanced-ct-implicit", enhanced(ENHANCED_CT, order), uid.ImplicitVRLittleEndian)
        one("enhanced-ct-big-endian", enhanced(ENHANCED_CT, order), uid.ExplicitVRBigEndian)
        one("enhanced-ct-deflated", enhanced(ENHANCED_CT, order), uid.DeflatedExplicitVRLittleEndian)
        one("enhanced-tilt", enhanced(ENHANCED_CT, order, mat=self.s.sheared()), affine=self.s.sheared(), same="tilt")
        slopes = 0.25 + 0.125 * (np.arange(count) % 5)
        stored = np.clip(np.rint((base.astype(float) + 1000) / slopes[:, None, None]), 0, 65535).astype(int)
        one("enhanced-mr-slopes", enhanced(ENHANCED_MR, order, stored, slopes), iso=1200.0, same=None,
            values=stored * slopes[:, None, None])
        one("x-enhanced-missing", enhanced(ENHANCED_CT, straight[straight != 17]), expect="refused",
            reason="missing|gap|uneven")
        ds = enhanced(ENHANCED_CT, order)
        images = np.frombuffer(ds.PixelData, "<u2").reshape(-1, ds.Rows, ds.Columns)
        j2k = [imagecodecs.jpeg2k_encode(i, codecformat="j2k", level=0, reversible=True) for i in images]
        ls = [bytes(imagecodecs.jpegls_encode(i)) for i in images]
        for name, syntax, coded, offsets, parts in (
                ("rle", uid.RLELossless, [rle(i) for i in images], "basic", 1),
                ("rle-no-offsets", uid.RLELossless, [rle(i) for i in images], "none", 1),
                ("rle-extended-offsets", uid.RLELossless, [rle(i) for i in images], "extended", 1),
                ("jpegls", uid.JPEGLSLossless, ls, "none", 1),
                ("jpegls-fragments", uid.JPEGLSLossless, ls, "basic", 3),
                ("jpegls-fragments-no-offsets", uid.JPEGLSLossless, ls, "none", 3),
                ("j2k-fragments", uid.JPEG2000Lossless, j2k, "basic", 4)):
            save_encapsulated(ds, self.s.path(f"dicom/enhanced-{name}.dcm"), syntax, coded, offsets=offsets, parts=parts)
            self.truth(f"enhanced-{name}.dcm")
        folder = self.s.folder("dicom/enhanced-two-files")
        first, second = enhanced(ENHANCED_CT, straight[:20]), enhanced(ENHANCED_CT, straight[20:])
        second.SeriesInstanceUID, second.SeriesNumber = first.SeriesInstanceUID, first.SeriesNumber
        save(second, folder / "1.dcm")
        save(first, folder / "2.dcm")
        self.truth("enhanced-two-files", expect="either", reason="several|files|frames", note="one series in two files")
        self.series += 1
        plain = blank(NM, self.series, 1)
        plain.NumberOfFrames, plain.PixelSpacing = count, [number(SPACING[1]), number(SPACING[0])]
        plain.SpacingBetweenSlices, plain.SliceThickness = "1.5", "2"
        put_pixels(plain, base.astype(int) + 1024)
        plain.RescaleSlope, plain.RescaleIntercept = "1", "-1024"
        one("legacy-frames", plain, origin=False, warn="position|order|frame",
            note="frames in their order, Spacing Between Slices apart")
        self.series += 1
        dose = blank(RT_DOSE, self.series, 1)
        place(dose, affine, 0)
        dose.NumberOfFrames = count
        put_pixels(dose, (base.astype(np.int64) + 1000) * 1000, bits=32)
        dose.FrameIncrementPointer = (0x3004, 0x000C)
        dose.GridFrameOffsetVector = [number(1.5 * z) for z in range(count)]
        dose.DoseGridScaling = "0.0009765625"
        scaled = (base.astype(float) + 1000) * 1000 / 1024
        one("rt-dose", dose, values=scaled, iso=1171.875, same="structure:base")
        dose.GridFrameOffsetVector = [number(30 + 1.5 * z) for z in range(count)]
        one("rt-dose-absolute", dose, values=scaled, iso=1171.875, same="structure:base",
            note="offsets that begin with the position's own z")
        dose.GridFrameOffsetVector = [number(1.5 * z + (4 if z > 20 else 0)) for z in range(count)]
        one("x-rt-dose-uneven", dose, values=scaled, expect="refused", reason="missing|gap|uneven")
        dose.GridFrameOffsetVector = [number(7 + 1.5 * z) for z in range(count)]
        one("rt-dose-first-offset", dose, values=scaled, iso=1171.875, same="structure:base",
            note="offsets that begin with neither 0 nor the position's z")
        half = (base // 2).astype(np.int16)
        both = np.stack([base, half], 1).reshape(2 * count, *base.shape[1:])
        slots = copy.deepcopy(plain)
        put_pixels(slots, both.astype(int) + 1024)
        slots.NumberOfFrames, slots.FrameIncrementPointer = 2 * count, [0x00540070, 0x00540080]
        slots.TimeSlotVector = [1, 2] * count
        slots.SliceVector = [1 + z // 2 for z in range(2 * count)]
        slots.DetectorInformationSequence = sequence(ImagePositionPatient=[number(v) for v in affine[:, 3]],
                                                     ImageOrientationPatient=["1", "0", "0", "0", "1", "0"])
        one("nm-time-slots", slots, others=[(half.astype(float), affine)], same=None, warn="frame vectors",
            note="two time slots, slice by slice")
        two = enhanced(ENHANCED_MR, np.concatenate([straight, straight]))
        put_pixels(two, np.concatenate([base, half]).astype(int) + 1024)
        for i, item in enumerate(two.PerFrameFunctionalGroupsSequence):
            item.FrameContentSequence = sequence(DimensionIndexValues=[1 + i % count, 1 + i // count])
        mixed = self.s.rng.permutation(2 * count)
        pixels = np.frombuffer(two.PixelData, "<u2").reshape(2 * count, -1)
        two.PixelData = pixels[mixed].tobytes()
        two.PerFrameFunctionalGroupsSequence = Sequence([two.PerFrameFunctionalGroupsSequence[i] for i in mixed])
        one("enhanced-two-by-dimension", two, others=[(half.astype(float), affine)], same=None, warn="Dimension Index",
            note="only the dimension index values tell two volumes apart")
        mask = base > 200

        def segmentation(sop, frames, images, bits):
            made = enhanced(sop, np.array([z for _, z in frames]))
            made.Modality, made.ImageType = "SEG", ["DERIVED", "PRIMARY"]
            del made.SharedFunctionalGroupsSequence[0].PixelValueTransformationSequence
            put_pixels(made, images.astype(np.uint8), bits=8)
            if bits == 1:
                made.BitsAllocated, made.BitsStored, made.HighBit = 1, 1, 0
                made.PixelData = np.packbits(images.astype(np.uint8).ravel(), bitorder="little").tobytes()
                made.PixelData += b"\0" * (len(made.PixelData) % 2)
                for (segment, _), item in zip(frames, made.PerFrameFunctionalGroupsSequence):
                    item.SegmentIdentificationSequence = sequence(ReferencedSegmentNumber=segment)
            return made

        upper = affine.copy()
        upper[:, 3] += 20 * affine[:, 2]
        one("seg-one-above-the-other", segmentation(SEGMENTATION, [(1 + (z >= 20), z) for z in range(count)], mask, 1),
            values=mask[:20].astype(float), others=[(mask[20:].astype(float), upper)], iso=0.5, same=None,
            note="two segments in different slices")
        kept = [z for z in range(count) if not 10 <= z < 14]
        hollow = mask.astype(float)
        hollow[10:14] = 0
        one("seg-without-empty-frames", segmentation(SEGMENTATION, [(1, z) for z in kept], mask[kept], 1),
            values=hollow, iso=0.5, same=None, warn="no frame", note="slices without a frame are empty")
        labels = mask.astype(int) + (base > 700)
        coloured = segmentation(LABEL_MAP, [(0, z) for z in range(count)], labels, 8)
        coloured.PhotometricInterpretation = "PALETTE COLOR"
        for tag, colours in enumerate(([0, 200, 30, 90], [0, 10, 220, 90], [0, 30, 40, 250])):
            coloured.add_new(0x00281101 + tag, "US", [4, 0, 8])
            coloured.add_new(0x00281201 + tag, "OW", bytes(colours))
        one("seg-label-map-palette", coloured, values=labels.astype(float), iso=1.5, same=None,
            note="labels are numbers whatever their colours")
