"""The Siemens mosaics of make_studies.py: the slices of a volume as tiles of one picture.

Where a picture has to say that it lies is computed here from its middle, which is that of the first slice.
"""
import copy
import struct

import numpy as np
from pydicom import uid

import study_dicom as dicom

FIRST = [("EchoLinePosition", b"IS", ["64      ", "", "", "", "", ""]), ("B_value", b"IS", [])]


def csa(tags, newer=True):
    """The private header: newer (SV10) or older form."""
    out = b"SV10\4\3\2\1" if newer else b""
    out += struct.pack("<2I", len(tags), 77)
    for name, vr, items in tags:
        out += struct.pack("<64si4s3i", name.encode(), len(items), vr, 6, len(items), 77)
        for text in items:
            n = len(text)
            head = (n, n, 77, n) if newer else (n + len(tags[0][2]), n + len(tags[0][2]), 77, n)
            out += struct.pack("<4i", *head) + text.encode() + b"\0" * (-n % 4)
    return out


def mosaic(studies, values, affine, *, tiles=None, backwards=False, header="newer", number=True, time=1):
    """A picture of slices values[z, y, x]; tiles in a row by the number of slices unless stated."""
    count, rows, columns = values.shape
    across = tiles or int(np.ceil(np.sqrt(count)))
    order = range(count)[::-1] if backwards else range(count)
    picture = np.zeros((across * rows, across * columns), int)
    for tile, z in enumerate(order):
        y, x = divmod(tile, across)
        picture[y * rows:(y + 1) * rows, x * columns:(x + 1) * columns] = values[z].astype(int) + 1024
    ds = dicom.blank(dicom.MR, studies.series, time)
    ds.ImageType, ds.Manufacturer = ["ORIGINAL", "PRIMARY", "M", "ND", "MOSAIC"], "SIEMENS"
    dicom.place(ds, affine, order[0])
    middle = affine @ [(columns - 1) / 2, (rows - 1) / 2, order[0], 1]
    corner = middle - affine[:, 0] * (across * columns - 1) / 2 - affine[:, 1] * (across * rows - 1) / 2
    ds.ImagePositionPatient = [dicom.number(v) for v in corner]
    ds.SpacingBetweenSlices = dicom.number(dicom.SPACING[2])
    ds.AcquisitionNumber = time
    dicom.put_pixels(ds, picture)
    ds.RescaleSlope, ds.RescaleIntercept = "1", "-1024"
    if number:
        block = ds.private_block(0x0019, "SIEMENS MR HEADER", create=True)
        block.add_new(0x0A, "US", count)
    if header:
        normal = affine[:, 2] / np.linalg.norm(affine[:, 2]) * (-1 if backwards else 1)
        tags = [*FIRST, ("AcquisitionMatrixText", b"SH", [f"{columns}p*{rows}"]),
                ("NumberOfImagesInMosaic", b"IS", [f"{count:<8d}", "", "", "", "", ""]),
                ("SliceNormalVector", b"FD", [*(f"{v:.8f}" for v in normal), "", "", ""])]
        block = ds.private_block(0x0029, "SIEMENS CSA HEADER", create=True)
        block.add_new(0x10, "OB", csa(tags, header == "newer"))
    return ds


def write(studies):
    """Writes below OUT/dicom; `studies` is a DicomStudies."""
    base, affine, turned = studies.base, studies.s.affine, studies.s.oblique()

    def one(name, values=base, at=affine, syntax=uid.ExplicitVRLittleEndian, truth=(), **how):
        studies.series += 1
        ds = mosaic(studies, values, at, **how)
        studies.write_series(name, [ds], syntax)
        studies.truth(name, values.astype(float), affine=at, **dict(truth))
        return ds

    plain = one("mosaic", truth={"note": "36 tiles of one picture"})
    one("mosaic-implicit", syntax=uid.ImplicitVRLittleEndian)
    one("mosaic-backwards", backwards=True, truth={"note": "the first tile is the last slice"})
    one("mosaic-older-header", header="older", backwards=True)
    one("mosaic-oblique", at=turned, truth={"same": "structure:base"})
    one("mosaic-oblique-backwards", at=turned, backwards=True, truth={"same": "structure:base"})
    one("mosaic-empty-tiles", base[:28], truth={"same": None, "note": "28 of 36 tiles are slices"})
    one("mosaic-no-header", header=None, truth={"warn": "direction", "note": "only the number of slices is stated"})
    studies.s.folder("dicom/mosaic-rle")
    dicom.save_encapsulated(plain, studies.s.path("dicom/mosaic-rle/1.dcm"), uid.RLELossless,
                            [dicom.rle(np.frombuffer(plain.PixelData, "<u2").reshape(plain.Rows, plain.Columns))])
    studies.truth("mosaic-rle")
    studies.series += 1
    values = [base, (base // 2).astype(np.int16), (base // 4).astype(np.int16)]
    made = [mosaic(studies, v, affine, time=t + 1) for t, v in enumerate(values)]
    studies.write_series("mosaic-times", made)
    studies.truth("mosaic-times", warn="3 volumes", same=None, note="three points in time",
                  others=[(v.astype(float), affine) for v in values[1:]])
    refused = {"expect": "refused", "same": None, "reason": "[Mm]osaic"}
    one("x-mosaic-unknown", header=None, number=False, truth={**refused, "note": "nothing states the number of slices"})
    one("x-mosaic-uneven", base[:20], tiles=7, truth={**refused, "note": "20 slices in 7 x 7 tiles, not in 5 x 5"})
    two = copy.deepcopy(plain)
    two[0x0019, 0x100A].value = 35
    studies.write_series("x-mosaic-contradiction", [two])
    studies.truth("x-mosaic-contradiction", **refused, note="36 slices, and 35 in another place")
