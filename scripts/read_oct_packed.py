"""Decodes the groups of a packed .oct with the standard library alone, from sections 5.8 to 5.12 of
src/format/SPEC.md: infobytes, normals, and offsets of cells. Used by read_oct.py; some 5,000 voxels a second.
"""
import os
import struct

SCALE = 127
TOKENS = [(0, 0), (1, 1), (2, 1), (3, 1), (4, 1), (5, 1), (6, 2), (8, 3), (12, 3), (16, 4), (24, 4), (32, 5),
               (48, 5), (64, 6), (96, 6), (128, 8)]
OFF_LIMITS = [1, 3, 5, 7, 10, 14, 19, 26, 36, 52, 76, 110, 160, 230]


class Broken(Exception):
    """The bytes break a rule."""


class Table:
    def __init__(self, fast, slow):
        self.shifts = fast, slow
        self.rows = [[4096 * i for i in range(16)] for _ in range(2)]
        self.seen = 0

    def learn(self, symbol):
        fast, slow = self.shifts
        self.seen = min(self.seen + 1, 2 * slow)
        shift = (self.seen + 1) >> 1
        for row, by in zip(self.rows, (min(shift, fast), shift)):
            for i in range(1, 16):
                if i <= symbol:
                    row[i] -= (row[i] - 6 * i) >> by
                else:
                    row[i] += (65536 - 6 * (16 - i) - row[i]) >> by


class Tables(dict):
    def __init__(self, fast, slow):
        super().__init__()
        self.shifts = fast, slow

    def __missing__(self, context):
        self[context] = Table(*self.shifts)
        return self[context]


class Coder:
    """One group's payload (SPEC 5.5)."""

    def __init__(self, payload):
        if len(payload) % 2:
            raise Broken("half a word")
        self.words = struct.unpack(f"<{len(payload) // 2}H", payload)
        self.at = self.items = 0
        self.begin()

    def word(self):
        if self.at == len(self.words):
            raise Broken("a group ends early")
        self.at += 1
        return self.words[self.at - 1]

    def begin(self):
        self.states = [self.word() | self.word() << 16 for _ in range(2)]
        self.items = 0

    def step(self, begin, width):
        state = self.states[0]
        state = width * (state >> 15) + state % 32768 - begin
        if state < 65536:
            state = state << 16 | self.word()
        self.states = [self.states[1], state]

    def symbol(self, first, second):
        m = [[(x + y + 1) >> 1 for x, y in zip(*table.rows)] for table in (first, second)]
        begins = [(x + y + 1) >> 1 >> 1 for x, y in zip(*m)] + [32768]
        value = self.states[0] % 32768
        symbol = max(i for i in range(16) if begins[i] <= value)
        self.step(begins[symbol], begins[symbol + 1] - begins[symbol])
        first.learn(symbol)
        second.learn(symbol)
        return symbol

    def even(self, bits):
        value = self.states[0] % 32768 >> (15 - bits)
        self.step(value << (15 - bits), 1 << (15 - bits))
        return value

    def difference(self, symbol, bits=None):
        least = TOKENS[symbol][0]
        bits = bits or TOKENS[symbol][1]
        low = self.even(bits)
        size = least + (low >> 1)
        return -size if low & 1 else size

    def end_item(self):
        self.items += 1
        if self.items == 1 << 14:
            self.end_block()
            if self.at < len(self.words):
                self.begin()

    def end_block(self):
        if self.states != [65536, 65536]:
            raise Broken("a block ends otherwise than it must")
        self.items = 0

    def finish(self):
        if self.items:
            self.end_block()
        if self.at != len(self.words):
            raise Broken("a group has words left over")


def klass(value, limits):
    return sum(abs(value) > limit for limit in limits)


def share(n):
    return 65536 // n if n else 0


def vector(code):
    u, v = [c - 256 if c > 127 else c for c in (code & 255, code >> 8)]
    z = SCALE - abs(u) - abs(v)
    if z >= 0:
        return u, v, z
    return (SCALE - abs(v)) * (-1 if u < 0 else 1), (SCALE - abs(u)) * (-1 if v < 0 else 1), z


def chart(n):
    if n[2] >= 0:
        return n[0], n[1]
    return (SCALE - abs(n[1])) * (-1 if n[0] < 0 else 1), (SCALE - abs(n[0])) * (-1 if n[1] < 0 else 1)


AROUND = [(x, y, z, {1: 8, 2: 3, 3: 1}[abs(x) + abs(y) + abs(z)])
          for z in (-1, 0, 1) for y in (-1, 0, 1) for x in (-1, 0, 1) if x or y or z]


class Groups:
    """The stored bytes of a section (SPEC 5.2)."""

    def __init__(self, stored, at=0):
        self.stored, self.at = stored, at

    def next(self, coder=Coder):
        length, subtrees = struct.unpack_from("<II", self.stored, self.at)
        self.at += 8 + length
        if self.at > len(self.stored) or not subtrees:
            raise Broken("a group is longer than its section, or empty")
        return coder(self.stored[self.at - length:self.at]), subtrees


class Bits:
    """One group's payload (SPEC 5.6)."""

    def __init__(self, payload):
        if len(payload) % 4 or not payload:
            raise Broken("half a word")
        self.words = struct.unpack(f"<{len(payload) // 4}I", payload)
        self.at, self.range = 0, 2 ** 64 - 1
        self.above = self.word() << 32
        self.above |= self.word()

    def word(self):
        self.at += 1
        return self.words[self.at - 1] if self.at <= len(self.words) else 0

    def bit(self, one):
        ones = (self.range >> 16) * one
        bit = self.above < ones
        if bit:
            self.range = ones
        else:
            self.above -= ones
            self.range -= ones
        if self.range < 2 ** 32:
            self.range <<= 32
            self.above = self.above << 32 | self.word()
        return int(bit)

    def finish(self):
        if self.at != len(self.words) + 1:
            raise Broken("a group ends early, or has words left over")


def halves():
    power = 2 ** 32
    for _ in range(2048):
        yield 2 ** 48 // (2 ** 32 + power)
        power = 4278222805 * power >> 32


HALVES = list(halves())
SQUASHED = [65536 - HALVES[-x] if x < 0 else HALVES[x] for x in range(-2047, 2048)]
STRETCHED = []
for n in range(4096):
    x = STRETCHED[-1] if STRETCHED else -2047
    while x < 2047 and SQUASHED[x + 1 + 2047] <= 16 * n + 8:
        x += 1
    STRETCHED.append(x)


def hold(value, most):
    return max(-most, min(most, value))


class Mixer:
    """Three tables and the weights of all (SPEC 5.6)."""

    def __init__(self):
        self.tables, self.weights = [{}, {}, {}], {}

    def slot(self, table, key):
        pair = table.setdefault(key >> 8, [[32768, 0, 0], [32768, 0, 0]])
        for slot in pair:
            if slot[2] == key & 255:
                return slot
        slot = min(pair, key=lambda slot: slot[1])
        slot[:] = 32768, 0, key & 255
        return slot

    def bit(self, coder, keys, place, prior):
        slots = [self.slot(table, key) for table, key in zip(self.tables, keys)]
        inputs = [prior] + [STRETCHED[slot[0] >> 4] for slot in slots] + [256]
        counts = [sum(slot[1] > limit for limit in (0, 2, 7)) for slot in slots[:2]]
        weights = self.weights.setdefault((place, *counts), [39322, 19661, 22938, 13107, 0])
        mixed = hold(sum(w * x >> 2 for w, x in zip(weights, inputs)) >> 14, 2047)
        one = max(24, min(65512, SQUASHED[mixed + 2047]))
        bit = coder.bit(one)
        error = 65536 * bit - one
        weights[:] = [hold(w + (x * error + 8192 >> 14), (1 << 19) - 1) for w, x in zip(weights, inputs)]
        for slot in slots:
            slot[0] += (65535 * bit - slot[0]) * (131072 // (2 * slot[1] + 3)) >> 16
            slot[1] = min(slot[1] + 1, 60)
        return bit


class Prior:
    """The net (SPEC 5.9)."""

    def __init__(self):
        folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
        with open(os.path.join(folder, "src/format/prior.hex")) as text:
            weights = [b - 256 if b > 127 else b for b in bytes.fromhex(text.read().replace("\n", ""))]
        rows = [weights[at:at + 32] for at in range(0, 4128, 32)]
        self.inputs, self.own, self.first, self.last = rows[:112], rows[112:120], rows[120], rows[121:]
        self.bias = weights[4128:]

    def sums(self, inputs):
        rows = [self.first] + [row for row, there in zip(self.inputs, inputs) if there]
        return [16 * sum(column) for column in zip(*rows)]

    def logit(self, sums, bit):
        total = 256 * self.bias[bit] + sum(s * w for s, w in zip(sums, self.last[bit]) if s > 0)
        return hold(total >> 4, 2047)

    def note(self, sums, bit):
        return [s + 16 * w for s, w in zip(sums, self.own[bit])]


def line(y, z, first, last):
    return [(x, y, z) for x in range(first, last + 1)]


BOXES_AROUND = ([at for y in range(-2, 4) for at in line(y, -1, -2, 3)]
                + [at for y in range(-1, 3) for at in line(y, -2, -1, 2)]
                + line(-1, 0, -2, 3) + line(-1, 1, -2, 3) + line(-2, 0, -1, 2) + line(-2, 1, -1, 2)
                + [at for z in (0, 1) for y in (0, 1) for at in line(y, z, -2, -1)])
NODES_AROUND = (line(0, 0, 1, 2) + line(1, 0, -2, 2) + line(2, 0, -1, 1)
                + [at for y in (-1, 0, 1) for at in line(y, 1, -2, 2)]
                + line(-1, 2, 0, 0) + line(0, 2, -1, 1) + line(1, 2, 0, 0))
CUBE_AROUND = [(u, v, w) for w in (-1, 0, 1) for v in (-1, 0, 1) for u in (-1, 0, 1)]


def hashed(fields, factor):
    return (fields * factor) % 2 ** 64 >> 41


def infobyte(coder, mixer, prior, node, present, boxes, level, leaves):
    """One infobyte (SPEC 5.6): `boxes` are those that exist or whose nodes are not coded yet."""
    x, y, z = node
    own = {(2 * x + (i & 1), 2 * y + (i >> 1 & 1), 2 * z + (i >> 2)): i for i in range(8)}
    boxes.difference_update(own)
    inputs = [(2 * x + i, 2 * y + j, 2 * z + k) in boxes for i, j, k in BOXES_AROUND]
    inputs += [(x + i, y + j, z + k) in present for i, j, k in NODES_AROUND] + [level == 0, level == 1]
    sums, mask = prior.sums(inputs), 0
    nodes = sum(((x + u, y + v, z + w) in present) << (u + 1 + 3 * (v + 1) + 9 * (w + 1)) for u, v, w in CUBE_AROUND)
    for (a, b, c), i in own.items():
        if i == 7 and not mask and not leaves:
            mask = 128
            break
        every = near = (i + 8 * level) << 48
        for u, v, w in CUBE_AROUND:
            if (a + u, b + v, c + w) in boxes:
                bit = 1 << (u + 1 + 4 * (v + 1) + 16 * (w + 1))
                every += bit
                near += bit if not (u and v and w) else 0
        early = max(i - 3, 0)
        m, n = (own >> early | (own & (1 << early) - 1) << 3 for own in (mask, mask & ~(1 << (7 - i))))
        keys = (hashed(near, 0x9e3779b97f4a7c15) ^ n << 8,
                hashed(every, 0xd6e8feb86659fd93) ^ m << 8,
                hashed(nodes | level << 48, 0x9e3779b97f4a7c15) ^ i << 15 ^ m << 8)
        if mixer.bit(coder, keys, 3 * i + level, prior.logit(sums, i)):
            mask |= 1 << i
            sums = prior.note(sums, i)
    boxes.update(box for box, i in own.items() if mask >> i & 1)
    return mask


def nodes(stored, levels, depth, larger):
    """NODE (SPEC 5.6), and of every subtree of 5.7 the voxels in Morton order and how many larger leaves it has."""
    if depth == 0:
        return b"", [([(0, 0, 0)], 0)]
    top = max(depth - 7, 0)
    infobytes, at = blocks(stored, levels[top])
    groups, left = Groups(stored, at), levels[top + 1] - levels[top]
    parts, subtrees, prior = [[] for _ in range(top, depth)], [], Prior()
    while left:
        coder, count = groups.next(Bits)
        left -= count
        mixer, size, root_bits = Mixer(), 0, 0
        for _ in range(count):
            if size >= 1 << 18:
                raise Broken("a group ends later than where it is full")
            present, order, within = {(0, 0, 0)}, [(0, 0, 0)], {}
            for d, part in enumerate(parts, top):
                level, leaves = min(depth - 1 - d, 2), larger and d >= max(1, depth - 5)
                boxes = {(2 * x + (i & 1), 2 * y + (i >> 1 & 1), 2 * z + (i >> 2))
                         for x, y, z in order for i in range(8)}
                if d == max(depth - 6, 0):
                    within, root_bits = {root: [[], 0] for root in order}, 0
                masks = {node: infobyte(coder, mixer, prior, node, present, boxes, level, leaves)
                         for node in sorted(order, key=lambda node: node[::-1])}
                part += [masks[node] for node in order]
                for node in (node for node, mask in masks.items() if not mask):
                    size += 1
                    within[tuple(c >> root_bits for c in node)][1] += 1
                order = [(2 * x + (o & 1), 2 * y + (o >> 1 & 1), 2 * z + (o >> 2))
                         for x, y, z in order for o in range(8) if masks[x, y, z] >> o & 1]
                present, root_bits = set(order), root_bits + 1
            size += len(order)
            for voxel in order:
                within[tuple(c >> root_bits for c in voxel)][0].append(tuple(c & 63 for c in voxel))
            subtrees += within.values()
        if size < 1 << 18 and left:
            raise Broken("a group ends before it is full")
        coder.finish()
    if groups.at != len(stored):
        raise Broken("NODE has bytes left over")
    return infobytes + b"".join(bytes(part) for part in parts), subtrees


def blocks(stored, length):
    """Bytes stored with codec 1 (SPEC 5.3), and where they end."""
    content, at = b"", 0
    while len(content) < length:
        try:
            from compression import zstd
        except ImportError:
            raise Broken("needs Python 3.14 for zstd: models of up to 128 voxels a side do not") from None
        size = struct.unpack_from("<I", stored, at)[0]
        byte, part = 0, bytearray()
        for difference in zstd.decompress(stored[at + 4:at + 4 + size]):
            byte = (byte + difference) & 255
            part.append(byte)
        content += part
        at += 4 + size
    return content, at


def grouped(stored, subtrees):
    """Groups with their subtrees (SPEC 5.7)."""
    groups, first = Groups(stored), 0
    while first < len(subtrees):
        coder, count = groups.next()
        part = subtrees[first:first + count]
        full = [sum(len(voxels) + leaves for voxels, leaves in part[:n]) >= 1 << 17 for n in range(len(part) + 1)]
        if any(full[:-1]) or not full[-1] and first + count != len(subtrees):
            raise Broken("a group ends otherwise than where it is full")
        first += count
        yield coder, [voxels for voxels, _ in part]
        coder.finish()
    if groups.at != len(stored):
        raise Broken("a section has bytes left over")


def normals(stored, subtrees):
    """NORM (SPEC 5.7)."""
    codes = []
    for coder, part in grouped(stored, subtrees):
        off_tables, bent_tables = ([Tables(5, 7), Tables(5, 7)] for _ in range(2))
        twins, biases = [Tables(5, 7), Tables(5, 7)], [{}, {}]
        if coder.even(1):
            raise Broken("a reserved bit is set")
        for voxels in part:
            last, known, block = (0, 0, SCALE), {}, None
            for voxel in voxels:
                if tuple(c >> 5 for c in voxel) != block:
                    known, block = {}, tuple(c >> 5 for c in voxel)
                x, y, z = voxel
                weights, total = 0, [0] * 6
                for i, j, k, weight in AROUND:
                    near = known.get((x + i, y + j, z + k))
                    if near:
                        weights += weight
                        total = [a + weight * b for a, b in zip(total, near)]
                s = total[:3] if weights else list(last)
                if not any(s):
                    s = [0, 0, SCALE]
                part_of = (1 << 20) // sum(map(abs, s))
                guess = [(abs(c) * part_of * 2032 >> 20) * (-1 if c < 0 else 1) for c in s[:2]]
                mirror = s[2] < 0
                ahead, rows = [0, 0], 0
                for i, j, k in ((-1, 0, 0), (0, -1, 0), (0, 0, -1)):
                    near = known.get((x + i, y + j, z + k))
                    far = known.get((x + 2 * i, y + 2 * j, z + 2 * k))
                    if near and far:
                        rows += 1
                        ahead = [a + 2 * n - f for a, n, f in zip(ahead, near, far)]
                o = klass(4 * total[5] * share(weights) >> 16, OFF_LIMITS) if weights else 15
                first = 4 * o + klass(weights, [10, 20, 34])
                got, residuals, errors = [], [], []
                for c in range(2):
                    turn = (16 * ahead[c] * share(rows) >> 16) - guess[c] if rows else 0
                    error = total[3 + c] * share(weights) >> 16
                    t, h = klass(turn, [4, 12, 24, 48, 100, 240]), klass(error, [1, 3, 6, 12, 24, 60])
                    context = (16 * (o >> 1) + t + 8 * (turn < 0)) * 16 + h + 8 * (error < 0)
                    bias = biases[c].get(context, 0)
                    expected = max(-SCALE, min(SCALE, (guess[c] + (bias >> 4) + 8) >> 4))
                    q = klass(residuals[0], [1, 3, 8]) if c else 0
                    symbol = coder.symbol(off_tables[c][4 * first + q], bent_tables[c][4 * (8 * t + h) + q])
                    residual = coder.difference(symbol)
                    value = expected + residual
                    wrong = 16 * value - guess[c]
                    biases[c][context] = bias + ((16 * wrong - bias) >> 5)
                    got.append(value)
                    residuals.append(residual)
                    errors.append(max(-350, min(350, wrong >> 2)))
                if max(map(abs, got)) > SCALE:
                    raise Broken("a normal is out of range")
                n = vector((got[0] & 255) | (got[1] & 255) << 8)
                if mirror:
                    n = n[0], n[1], -n[2]
                plain = list(chart(n))
                if n[2] < 0:
                    for axis in range(2):
                        if n[axis] == 0 and coder.symbol(twins[0][axis], twins[1][axis]) & 1:
                            plain[axis] = -plain[axis]
                last = n
                known[voxel] = (*n, *errors, sum(min(abs(r), 120) for r in residuals))
                codes.append((plain[0] & 255) | (plain[1] & 255) << 8)
                coder.end_item()
    return struct.pack(f"<{len(codes)}H", *codes)


def offsets(stored, subtrees, norm):
    """OFFS of cells (SPEC 5.8)."""
    codes, done = struct.unpack(f"<{len(norm) // 2}H", norm), bytearray()
    for coder, part in grouped(stored, subtrees):
        spread_tables, off_tables = Tables(5, 7), Tables(5, 7)
        for cells in part:
            known, block = {}, None
            for cell in cells:
                if tuple(c >> 5 for c in cell) != block:
                    known, block = {}, tuple(c >> 5 for c in cell)
                own, says, cornered, off = vector(codes[len(done)]), [], 0, 0
                for i, j, k, kind in AROUND:
                    near = known.get((cell[0] + i, cell[1] + j, cell[2] + k))
                    if near and near[1] is None:
                        cornered += 1
                    elif near:
                        apart = sum(abs(a - b) for a, b in zip(own, near[0]))
                        weight = max(64 * 32 * kind // (32 + apart * apart), 1)
                        step = sum((a + b) * d for a, b, d in zip(own, near[0], (i, j, k)))
                        says.append((near[1] + step, weight))
                        off += near[2]
                expected, d, o = 0, 15, 15
                if says:
                    weights = sum(w for _, w in says)
                    total = sum(s * w for s, w in says)
                    expected = max(-SCALE, min(SCALE, (2 * total + weights) // (2 * weights)))
                    far = sum(w * min(abs(s - expected), 80) for s, w in says)
                    d = klass(4 * far // weights, [3, 7, 11, 15, 21, 27, 35, 47, 63, 90])
                    o = klass(4 * off * share(len(says)) >> 16, OFF_LIMITS)
                context = 8 * d + klass(len(says), [0, 1, 2, 4, 7])
                symbol = coder.symbol(spread_tables[context], off_tables[4 * o + min(cornered, 3)])
                if symbol == 15:
                    known[cell] = own, None, 0
                    done.append(128)
                else:
                    residual = coder.difference(symbol, 9 if symbol == 14 else None)
                    offset = expected + residual
                    if abs(offset) > SCALE:
                        raise Broken("an offset is out of range")
                    known[cell] = own, offset, min(abs(residual), 120)
                    done.append(offset & 255)
                coder.end_item()
    return bytes(done)
