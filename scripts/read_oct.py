#!/usr/bin/env python3
"""Reads an .oct with the standard library alone, from src/format/SPEC.md, and prints JSON.

Second opinion on the format: checks header, table and every CRC, walks the octree from the root by
ranks of its own, recounts nodes per depth and voxels, and reads the metadata. Of a packed file it decodes
infobytes, normals and offsets of cells (read_oct_packed.py) and holds them to the CRC of their content.
Exit 1 and a sentence when something is wrong. For small and middling files: it walks about 300,000 boxes a second.

usage: read_oct.py MODEL.oct
"""
import json
import struct
import sys

sys.dont_write_bytecode = True
import read_oct_packed

SCALARS = ["u8", "i8", "u16", "i16", "u32", "i32", "f32", "f64"]
TABLE = []
for n in range(256):
    for _ in range(8):
        n = n >> 1 ^ (0x82F63B78 if n & 1 else 0)
    TABLE.append(n)


def crc32c(data, crc=0):
    crc ^= 0xFFFFFFFF
    for byte in data:
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
    return crc ^ 0xFFFFFFFF


def need(condition, rule):
    if not condition:
        sys.exit(f"{sys.argv[1]}: {rule}")


class Fields:
    """Metadata fields in a row (SPEC 4.4)."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, form):
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values if len(values) > 1 else values[0]

    def string(self):
        length = self.take("Q")
        self.at += length
        need(self.at <= len(self.data), "metadata ends early (I6)")
        return self.data[self.at - length:self.at].decode("utf-8")


def unpack(sections, due, levels, depth, larger):
    """Replaces the stored bytes of NODE, NORM and OFFS by their content, if they are in groups (SPEC 5.6 to 5.9)."""
    codecs = {tag: codec for tag, (codec, _, _) in due.items()}
    need(codecs["NODE"] == 9 and codecs.get("NORM", 7) == 7, "packed by an earlier version: unpack it first")
    try:
        sections["NODE"], subtrees = read_oct_packed.nodes(sections["NODE"], levels, depth, larger)
        if "NORM" in sections:
            sections["NORM"] = read_oct_packed.normals(sections["NORM"], subtrees)
        if codecs.get("OFFS") == 8:
            sections["OFFS"] = read_oct_packed.offsets(sections["OFFS"], subtrees, sections["NORM"])
    except read_oct_packed.Broken as rule:
        need(False, rule)
    for tag, (codec, length, crc) in due.items():
        if codec >= 7:
            content = sections[tag]
            need(len(content) == length and crc32c(content) == crc, f"bad content of {tag} (I8)")


def main():
    data = open(sys.argv[1], "rb").read()
    need(data[:8] == b"\x89OCT\r\n\x1a\n", "not an infobyte .oct (I1)")
    need(len(data) >= 64, "cut short (I2)")
    (major, minor, encoding, depth, count, length, nodes, voxels, nx, ny, nz, zero, table_crc,
     header_crc) = struct.unpack_from("<HHBBHQQQIIIIII", data, 8)
    need(header_crc == crc32c(data[:60]) and major == 1 and zero == 0, "bad header (I1)")
    need(length == len(data), "wrong length (I2)")
    packed, cells, larger, walls = (encoding >> bit & 1 for bit in range(4))
    need(encoding & ~1 in (0, 2, 6, 10), "unknown encoding (I1)")
    need(depth == (max(nx, ny, nz) - 1).bit_length(), "depth does not fit the dims (I5)")
    table = data[64:64 + 48 * count]
    need(len(table) == 48 * count and crc32c(table) == table_crc, "bad table (I3)")
    sections, due, end, fingerprint = {}, {}, 64 + 48 * count, b""
    for at in range(0, len(table), 48):
        tag, codec, item, zero, offset, stored, content, items, crc, content_crc = struct.unpack_from(
            "<4sBBHQQQQII", table, at)
        need(offset == (end + 63) // 64 * 64 and not any(data[end:offset]), "gap between sections (I3, I9)")
        need(zero == 0 and content == item * items, "bad table entry (I3, I4)")
        need(packed or codec == 0, "a codec in a mapped file (I4)")
        need(codec or (stored, crc) == (content, content_crc), "bad table entry (I3)")
        end = offset + stored
        need(end <= len(data) and crc32c(data[offset:end]) == crc, f"bad CRC of {tag} (I8)")
        sections[tag.decode()] = data[offset:end]
        due[tag.decode()] = codec, content, content_crc
        fingerprint += b"" if tag == b"RANK" else tag + struct.pack("<I", content_crc)
    need(end == len(data), "bytes after the last section (I3)")

    stored_bytes = {tag: len(stored) for tag, stored in sections.items()}
    levels = struct.unpack(f"<{depth + 1}Q", sections["LEVL"])
    if packed:
        unpack(sections, due, levels, depth, larger)
    need(walls == ("LTAB" in sections), "labels without walls, or walls without labels (I4)")
    if cells and not packed:
        with_item = sections["OFFS"].count(b"\x80")
        need(len(sections["CORN"]) == (20 if walls else 8) * with_item, "corners where the offsets announce others (I18)")
    infobytes = sections["NODE"]
    need(len(infobytes) == nodes == levels[-1] and levels[0] == 0, "levels and nodes disagree (I7)")
    # Depths at which a node may be a larger leaf.
    first = levels[max(1, depth - 5)] if larger and depth else nodes
    need(all(infobytes[:first]), "a node without children (I10)")
    leaves = [node for node, mask in enumerate(infobytes) if not mask]
    if larger:
        planes = sections["LNRM"], sections["LOFS"]
        need((len(planes[0]), len(planes[1])) == (2 * len(leaves), len(leaves)), "planes of larger leaves (I19)")
        need(b"\x80" not in planes[0] + planes[1], "an illegal plane (I14)")
        counted, at = b"", 0
        for block in range(0, nodes, 512):
            while at < len(leaves) and leaves[at] < block:
                at += 1
            counted += struct.pack("<Q", at)
        need(counted == sections["LRNK"], "directory of larger leaves (I19)")
    before = [0]  # set bits before every node: a rank directory of our own
    for mask in infobytes:
        before.append(before[-1] + bin(mask).count("1"))
    supers = (nodes + 8191) // 8192
    rank = b"".join(struct.pack("<Q", before[8192 * k]) for k in range(supers))
    rank += b"".join(struct.pack("<H", before[32 * j] - before[32 * j // 8192 * 8192])
                     for j in range((nodes + 31) // 32))
    need(packed or rank == sections["RANK"], "rank directory (I13)")
    seen, stack = [0] * (depth + 1), [(0, 0, 0, 0, 0)]
    while stack:
        box, d, x, y, z = stack.pop()
        need(x < nx and y < ny and z < nz, "a box outside the volume (I12)")
        seen[d] += 1
        if d == depth:
            need(nodes <= box < nodes + voxels, "a voxel number out of range (I11)")
            continue
        need(levels[d] <= box < levels[d + 1], "a node number outside its depth (I11)")
        child, half = 1 + before[box], 1 << (depth - d - 1)
        for i in range(8):
            if infobytes[box] >> i & 1:
                stack.append((child, d + 1, x + half * (i & 1), y + half * (i >> 1 & 1), z + half * (i >> 2)))
                child += 1
    need(seen[:-1] == [b - a for a, b in zip(levels, levels[1:])], "nodes per depth (I11)")
    need(seen[-1] == voxels, "voxels (I11)")

    m = Fields(sections["META"])
    program, source = m.string(), {"format": m.string(), "kind": m.string()}
    source["files"], source["bytes"] = m.take("QQ")
    dims, scalar, spacing, affine = m.take("3I"), m.take("B"), m.take("3d"), m.take("12d")
    rescale, (kind, lo, hi), connectivity = m.take("2d"), m.take("Bdd"), m.take("B")
    gradient, _value_scale = m.string(), m.take("2d")
    error = m.take("4d") if larger else None
    need(m.at == len(sections["META"]) and tuple(n + cells for n in dims) == (nx, ny, nz), "metadata (I6)")
    names = {"NORM": "normal", "VALU": "value", "OFFS": "offset", "COLR": "color", "MATL": "material",
             "CORN": "corners"}
    print(json.dumps({
        "input": sys.argv[1], "format_version": f"{major}.{minor}", "encoding": "packed" if packed else "mapped", "dims": dims,
        "spacing_mm": spacing, "affine": [affine[0:4], affine[4:8], affine[8:12]], "grid": 1 << depth,
        "levels": depth, "level_nodes": seen[:-1], "dtype": SCALARS[scalar], "rescale": rescale,
        "range": {"kind": ["iso", "range", "otsu"][kind], "lo": lo if abs(lo) != float("inf") else None,
                  "hi": hi if abs(hi) != float("inf") else None},
        "connectivity": connectivity, "gradient": gradient, "program": program, "source": source,
        "nodes": nodes, "skin_voxels": voxels, "bytes": len(data),
        "structure_bytes": sum(stored_bytes[t] for t in ("LEVL", "NODE", "RANK") if t in stored_bytes),
        "channels": [n for t, n in names.items() if t in sections],
        **({"larger_leaves": {"leaves": len(leaves), **dict(zip(("bound", "rms", "p99", "most"), error))}} if larger else {}),
        "checksum": f"{crc32c(fingerprint):08x}"}))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main()
