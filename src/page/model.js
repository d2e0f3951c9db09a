'use strict';
// An octree of a surface as the page holds it, and rays through it in doubles. No DOM: runs in workers and node, too.

const BITS = Uint8Array.from({length: 256}, (_, byte) => {
    let count = 0;
    for (let rest = byte; rest; rest &= rest - 1) count++;
    return count;
});

/** Set bits of a 32-bit word. */
const bitsOf = word => BITS[word & 255] + BITS[word >>> 8 & 255] + BITS[word >>> 16 & 255] + BITS[word >>> 24];

/** Infobytes of a texel, whose fourth word is a count of what comes before. */
const PER_TEXEL = 12;
/** Most boxes that a ray looks at; the most that was seen is 1,004. */
const MAX_STEPS = 4096;

const sum3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const apply = (rows, p) => rows.map(row => sum3(row, p) + row[3]);
const turn = (rows, v) => rows.map(row => sum3(row, v));

/** Inverse of an affine of 3 rows of 4; throws where there is none. */
function inverse(rows) {
    const [a, b, c] = rows;
    const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    const columns = [cross(b, c), cross(c, a), cross(a, b)];
    const det = sum3(a, columns[0]);
    if (!(Math.abs(det) > 0) || !Number.isFinite(det)) throw new Error('the affine of the model has no inverse');
    return [0, 1, 2].map(i => {
        const row = columns.map(column => column[i] / det);
        return [...row, -sum3(row, rows.map(r => r[3]))];
    });
}

/** Texels of 96 bits and how many are set before; throws unless that many are set in all. */
function counted(bits, items, first, due, what) {
    const texels = new Uint32Array(4 * Math.max(1, Math.ceil(items / PER_TEXEL)));
    let before = first;
    for (let at = 0, texel = 0; at < items; at += PER_TEXEL, texel += 4) {
        texels[texel + 3] = before;
        for (let i = 0; i < PER_TEXEL && at + i < items; i++) {
            const byte = bits(at + i);
            texels[texel + (i >> 2)] |= byte << 8 * (i & 3);
            before += BITS[byte];
        }
    }
    if (before !== first + due) throw new Error(`${what}: ${before - first} are described where ${due} are due`);
    return texels;
}

/** Number behind bit `bit` of texel `at`, by the bits set before it; -1 where it is not set. */
function rank(texels, at, bit) {
    const base = 4 * at, word = bit >> 5;
    if (!(texels[base + word] >>> (bit & 31) & 1)) return -1;
    let count = texels[base + 3];
    for (let i = 0; i < word; i++) count += bitsOf(texels[base + i]);
    return count + bitsOf(texels[base + word] & (1 << (bit & 31)) - 1);
}

/** The L1-127 vector of a normal's two bytes, octahedral. */
function direction(u, v) {
    const z = 127 - Math.abs(u) - Math.abs(v);
    if (z >= 0) return [u, v, z];
    return [(u < 0 ? -1 : 1) * (127 - Math.abs(v)), (v < 0 ? -1 : 1) * (127 - Math.abs(u)), z];
}

/** Bytes of a cell that one plane does not part: the labels of its corners, or values of them. */
const itemBytes = labels => labels ? 16 : 8;

/** A measured value of a box; `null` for none. */
function valueOf({head, sections: {VALU}}, box) {
    const raw = head.value_bytes === 2 ? VALU[2 * box] | VALU[2 * box + 1] << 8 : VALU[box];
    return head.quantity && !raw ? null : head.value_scale[0] * raw + head.value_scale[1];
}

/** A model's place, which is known without its sections. */
function placed(head) {
    const toIndex = inverse(head.affine), lengths = [0, 1, 2].map(a => Math.hypot(...head.affine.map(row => row[a])));
    return {
        head, dims: head.dims, sections: {}, spacing: Math.min(...lengths),
        /** World mm to grid, in which box i of an axis is i to i + 1. */
        toGrid: toIndex.map(row => [row[0], row[1], row[2], row[3] + .5]),
        /** Grid to world mm. */
        toWorld: head.affine.map(row => [row[0], row[1], row[2], row[3] - .5 * (row[0] + row[1] + row[2])]),
        /** Normals as they are stored to world, not of unit length: the transposed inverse of the directions. */
        normalRows: [0, 1, 2].map(i => [0, 1, 2].map(a => toIndex[a][i] * (head.cells ? 1 : lengths[a]))),
    };
}

class Model {
    /**
     * @param head what `oct` says of the model: depth, dims, nodes, voxels, leaves, cells, affine (3 x 4, box index to LPS mm)
     * @param sections bytes by kind: NODE; NORM, OFFS, CORN, LABL, COLR, VALU, MATL, LNRM and LOFS where there are any
     */
    constructor(head, sections) {
        let {depth, nodes, voxels} = head, {NODE: infobytes, ...kept} = sections;
        Object.assign(this, placed(head), {sections: kept, cells: head.cells});
        const whole = n => Number.isSafeInteger(n) && n >= 0;
        if (![depth, nodes, voxels].every(whole) || depth > 16 || nodes + voxels >= 2 ** 32 || !head.dims.every(whole)) {
            throw new Error('the head of the model makes no sense');
        }
        if (depth === 0) [depth, nodes, infobytes] = [1, 1, Uint8Array.of(1)];
        Object.assign(this, {depth, nodes, voxels});
        if (infobytes?.length !== nodes) throw new Error('infobytes are missing');
        this.texels = counted(at => infobytes[at], nodes, 1, nodes - 1 + voxels, 'boxes');
        const sizes = {NORM: 2, OFFS: 1, LABL: 2, COLR: 3, VALU: head.value_bytes, MATL: 1};
        for (const [kind, bytes] of Object.entries(sizes)) {
            if (sections[kind] && sections[kind].length !== voxels * bytes) throw new Error(`${kind} is not of the right length`);
        }
        if (this.cells && !(sections.NORM && sections.OFFS && sections.CORN)) throw new Error('sections of cells are missing');
        this.corners = null;
        this.leaves = null;
        // Labels are places in the table from 1 on, 0 for none.
        this.labels = head.coarse ? null : head.labels ?? null;
        if (this.labels && !(sections.LABL && this.labels.length < 256 && sections.LABL.every(place => place <= this.labels.length))) {
            throw new Error('the labels of the model make no sense');
        }
        if (this.cells) {
            const corners = sections.CORN.length / itemBytes(this.labels);
            if (corners > 0) {
                // A bit for each cell that has some.
                const has = at => {
                    let byte = 0;
                    for (let i = 0; i < 8; i++) byte |= (sections.OFFS[8 * at + i] === 128) << i;
                    return byte;
                };
                this.corners = counted(has, Math.ceil(voxels / 8), 0, corners, 'cells with corners');
            } else if (sections.OFFS.includes(128)) {
                throw new Error('cells with corners: 0 are described');
            }
        }
        if (head.leaves > 0) {
            const has = at => {
                let byte = 0;
                for (let i = 0; i < 8 && 8 * at + i < nodes; i++) byte |= (infobytes[8 * at + i] === 0) << i;
                return byte;
            };
            this.leaves = counted(has, Math.ceil(nodes / 8), 0, head.leaves, 'larger leaves');
            if (sections.LNRM.length !== 2 * head.leaves || sections.LOFS.length !== head.leaves) throw new Error('larger leaves are missing');
        }
    }

    infobyte(node) {
        return this.texels[4 * Math.floor(node / PER_TEXEL) + (node % PER_TEXEL >> 2)] >>> 8 * (node & 3) & 255;
    }

    /** The normal of a voxel or cell in 16 bits. */
    normal(voxel) {
        const codes = this.sections.NORM;
        if (!codes) return null;
        return direction(codes[2 * voxel] << 24 >> 24, codes[2 * voxel + 1] << 24 >> 24);
    }

    /** Eight corners of a cell, above 0 inside, and more between labels; `null` of a plane. */
    cornersOf(cell) {
        if (!this.corners) return null;
        const number = rank(this.corners, Math.floor(cell / 96), cell % 96), bytes = itemBytes(this.labels);
        return number < 0 ? null : new Int8Array(this.sections.CORN.buffer, this.sections.CORN.byteOffset + bytes * number, bytes);
    }

    /** Planes of a cell between labels, and the label of each part by the planes that it is in front of. */
    walls(cell) {
        const item = this.cornersOf(cell), normal = this.normal(cell);
        if (!item) return [[[normal, this.sections.OFFS[cell] << 24 >> 24 & ~1]], this.sections.LABL.subarray(2 * cell, 2 * cell + 2)];
        const corners = Uint8Array.from(item.subarray(0, 8));
        if (item[8] === -128) return [[[[127, 0, 0], 0], [[0, 127, 0], 0], [[0, 0, 127], 0]], corners];
        const planes = [[normal, item[8]], [direction(item[10], item[11]), item[9]]], parts = new Uint8Array(4);
        corners.forEach((label, i) => {
            const [first, second] = planes.map(([n, k]) => sum3(n, [i & 1, i >> 1 & 1, i >> 2].map(bit => 2 * bit - 1)) > k);
            parts[first ? 1 + 2 * second : 0] = label;
        });
        parts[2] = parts[0];
        return [planes, parts];
    }

    /** Plane of a larger leaf. */
    leaf(node) {
        const number = rank(this.leaves, Math.floor(node / 96), node % 96), codes = this.sections.LNRM;
        return [direction(codes[2 * number] << 24 >> 24, codes[2 * number + 1] << 24 >> 24), this.sections.LOFS[number] << 24 >> 24];
    }

    /**
     * The first box that a ray meets: `{voxel, leaf, low, edge, t, normal, label, isWithin}`, or `null`.
     *
     * `origin` and `direction` are of the grid, `least` where the ray begins; t is along `direction`. `voxel` is -1 of a
     * larger leaf. The normal is as stored. Labels that are `hidden` by their places count as none; `isWithin` says that
     * the ray began in the label.
     */
    trace(origin, direction, least = 0, hidden = []) {
        const side = 2 ** this.depth, o = [0, 0, 0], d = [0, 0, 0], inv = [0, 0, 0];
        let flip = 0, t = least, end = Infinity;
        for (let a = 0; a < 3; a++) {
            [o[a], d[a]] = [origin[a], direction[a]];
            if (d[a] < 0) {
                [o[a], d[a]] = [side - o[a], -d[a]];
                flip |= 1 << a;
            }
            inv[a] = 1 / Math.max(d[a], 1e-30);
            t = Math.max(t, -o[a] * inv[a]);
            end = Math.min(end, (side - o[a]) * inv[a]);
        }
        if (!(t < end)) return null;
        const parents = new Array(this.depth + 1).fill(0);
        let level = this.depth - 1;
        const low = [0, 0, 0];
        const descend = () => {
            for (let a = 0; a < 3; a++) if ((low[a] + 2 ** level - o[a]) * inv[a] < t) low[a] += 2 ** level;
        };
        descend();
        let isFirst = true;
        for (let step = 0; step < MAX_STEPS; step++) {
            const edge = 2 ** level, node = parents[level + 1];
            const octant = (low[0] >> level & 1 | (low[1] >> level & 1) << 1 | (low[2] >> level & 1) << 2) ^ flip;
            const next = low.map((c, a) => (c + edge - o[a]) * inv[a]);
            const child = rank(this.texels, Math.floor(node / PER_TEXEL), node % PER_TEXEL * 8 + octant);
            if (child >= 0) {
                const isLeaf = this.leaves && child < this.nodes && !this.infobyte(child);
                if (level > 0 && !isLeaf) {
                    parents[level--] = child;
                    descend();
                    continue;
                }
                const met = this.meet(child, {o, d, low, edge, flip, enter: t, leave: Math.min(...next)}, hidden);
                if (met) {
                    met.isWithin = isFirst && this.cells && met.t === t;
                    const at = low.map((c, a) => flip >> a & 1 ? side - c - edge : c);
                    return {voxel: isLeaf ? -1 : child - this.nodes, leaf: isLeaf ? child : -1, low: at, edge, ...met};
                }
                isFirst = false;
            }
            const axis = next[0] <= next[1] ? (next[0] <= next[2] ? 0 : 2) : (next[1] <= next[2] ? 1 : 2);
            t = next[axis];
            const before = low[axis];
            low[axis] += edge;
            level = 31 - Math.clz32(before ^ low[axis]);
            if (level >= this.depth) return null;
            for (let a = 0; a < 3; a++) low[a] = low[a] >> level << level;
        }
        return null;
    }

    /** Where a ray meets the surface in a box that it passes: `{t, normal, label}` or `null`. */
    meet(box, {o, d, low, edge, flip, enter, leave}, hidden) {
        const isLeaf = box < this.nodes, cell = box - this.nodes;
        if (!this.cells) return {t: enter, normal: this.normal(cell)};
        const at = t => o.map((c, a) => Math.min(1, Math.max(-1, 2 * (c + d[a] * t - low[a]) / edge - 1)) * (flip >> a & 1 ? -1 : 1));
        if (this.labels) {
            const met = this.meetWalls(cell, at(enter), at(leave), hidden);
            return met && {...met, t: enter + (leave - enter) * met.s};
        }
        const corners = isLeaf ? null : this.cornersOf(cell);
        if (!corners) {
            const [normal, offset] = isLeaf ? this.leaf(box) : [this.normal(cell), this.sections.OFFS[cell] << 24 >> 24];
            const first = sum3(normal, at(enter)) - offset;
            if (first <= 0) return {t: enter, normal};
            const last = sum3(normal, at(leave)) - offset;
            return last <= 0 ? {t: enter + (leave - enter) * first / (first - last), normal} : null;
        }
        const [from, to] = [at(enter), at(leave)];
        const value = s => {
            const w = from.map((c, a) => (1 + c + (to[a] - c) * s) / 2);
            let sum = 0;
            for (let i = 0; i < 8; i++) {
                sum += corners[i] * (i & 1 ? w[0] : 1 - w[0]) * (i & 2 ? w[1] : 1 - w[1]) * (i & 4 ? w[2] : 1 - w[2]);
            }
            return sum;
        };
        const s = firstRoot(value);
        if (s < 0) return null;
        const w = from.map((c, a) => (1 + c + (to[a] - c) * s) / 2);
        const gradient = [0, 1, 2].map(a => {
            let sum = 0;
            for (let i = 0; i < 8; i++) {
                const part = [0, 1, 2].reduce((p, b) => b === a ? p : p * (i >> b & 1 ? w[b] : 1 - w[b]), corners[i]);
                sum += i >> a & 1 ? part : -part;
            }
            return -sum;
        });
        const smooth = this.normal(cell);
        const cosine = sum3(gradient, smooth) / Math.hypot(...gradient) / Math.hypot(...smooth);
        return {t: enter + (leave - enter) * s, normal: cosine < .5 ? gradient : smooth};
    }

    /** Where a ray that has been in no label comes to be in one, on its way through a cell: `{s, normal, label}` or `null`. */
    meetWalls(cell, from, to, hidden) {
        const [planes, parts] = this.walls(cell), crossed = [], sides = [];
        let fronts = 0;
        const label = () => hidden[parts[fronts]] ? 0 : parts[fronts];
        planes.forEach(([n, k], i) => {
            const first = sum3(n, from) - k, last = sum3(n, to) - k;
            fronts |= (first > 0) << i;
            sides.push(Math.abs(first) / Math.hypot(...n));
            if (first > 0 !== last > 0) crossed.push([first / (first - last), i]);
        });
        // Out of the label.
        const outward = i => planes[i][0].map(c => fronts >> i & 1 ? -c : c);
        if (label()) {
            const here = label(), walls = planes.map((_, i) => i).filter(i => {
                const there = parts[fronts ^ 1 << i];
                return there !== here || hidden[there];
            });
            walls.sort((i, j) => sides[i] - sides[j]);
            return {s: 0, normal: walls.length ? outward(walls[0]) : this.normal(cell), label: here};
        }
        crossed.sort((a, b) => a[0] - b[0]);
        for (const [s, i] of crossed) {
            fronts ^= 1 << i;
            if (label()) return {s, normal: outward(i), label: label()};
        }
        return null;
    }
}

/** Where a cubic over 0..1 is 0 or more first; -1 where it is nowhere. */
function firstRoot(value) {
    const f = [0, 1 / 3, 2 / 3, 1].map(value);
    if (f[0] >= 0) return 0;
    // Coefficients by Newton's divided differences, then the two places where the cubic turns.
    const third = 4.5 * (f[3] - 3 * f[2] + 3 * f[1] - f[0]);
    const second = 4.5 * (f[2] - 2 * f[1] + f[0]) - third;
    const first = 3 * (f[1] - f[0]) - second / 3 - third / 9;
    const turns = [];
    if (Math.abs(third) < 1e-6 * Math.abs(second)) {
        turns.push(-first / (2 * second));
    } else {
        const root = Math.sqrt(Math.max(0, second * second - 3 * third * first));
        turns.push((-second - root) / (3 * third), (-second + root) / (3 * third));
    }
    const stops = [...turns.filter(s => s > 0 && s < 1).sort((a, b) => a - b), 1];
    let low = 0;
    for (let high of stops) {
        if (value(high) >= 0) {
            for (let i = 0; i < 40; i++) {
                const middle = (low + high) / 2;
                if (value(middle) >= 0) high = middle;
                else low = middle;
            }
            return high;
        }
        low = high;
    }
    return -1;
}

if (typeof module !== 'undefined') module.exports = {Model, inverse, apply, turn, firstRoot};
