'use strict';
// Cameras in the world's millimetres (LPS): what is looked at, the way to it, and half the picture's height there.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, k) => a.map(c => c * k);
const added = (a, b, k = 1) => a.map((c, i) => c + k * b[i]);
const unit = a => scaled(a, 1 / Math.hypot(...a));
/** Turned about a unit axis, by radians. */
const turned = (v, axis, angle) => {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    return added(added(scaled(v, c), cross(axis, v), s), axis, dot(axis, v) * (1 - c));
};

/** Named views: what they look along, and what is at the top. */
const VIEWS = {
    front: [[0, 1, 0], [0, 0, 1]], back: [[0, -1, 0], [0, 0, 1]], left: [[-1, 0, 0], [0, 0, 1]], right: [[1, 0, 0], [0, 0, 1]],
    top: [[0, 0, -1], [0, 1, 0]], bottom: [[0, 0, 1], [0, -1, 0]], iso: [[-.55, .75, -.38], [0, 0, 1]],
};
const CUTS = ['none', 'x', 'y', 'z', 'sight'];
/** Angle between the picture's bottom and top in perspective, degrees. */
const FOV = 30;

class View {
    constructor(model) {
        // Of the surface where it is known, else of its boxes or the whole grid.
        const ends = model.extent?.() ?? [[0, 0, 0], model.dims], corners = [];
        for (let i = 0; i < 8; i++) corners.push(model.toWorld.map(row => dot(row, [0, 1, 2].map(a => ends[i >> a & 1][a])) + row[3]));
        const box = model.head.box_mm ?? [0, 1].map(end => [0, 1, 2].map(a => Math[end ? 'max' : 'min'](...corners.map(c => c[a]))));
        this.box = box;
        this.middle = scaled(added(box[0], box[1]), .5);
        this.reach = Math.max(Math.hypot(...added(box[1], box[0], -1)) / 2, 1e-9);
        Object.assign(this, {perspective: false, cut: 'none', cutAt: .5, flipped: false, dark: null, colors: true});
        /** Labels by number, and by their places in the table from 1 on which of them are hidden. */
        this.labels = model.head.labels ?? [];
        this.hidden = new Uint8Array(1 + this.labels.length);
        this.named('front');
    }

    /** Labels that are seen, as bits. */
    eyes() {
        const bits = new Uint32Array(8);
        this.labels.forEach((_, i) => { bits[i + 1 >> 5] |= (this.hidden[i + 1] ? 0 : 1) << (i + 1 & 31); });
        return bits;
    }

    /** Half the box's extent along a direction. */
    extent(axis) {
        return [0, 1, 2].reduce((sum, a) => sum + Math.abs(axis[a]) * (this.box[1][a] - this.box[0][a]) / 2, 0);
    }

    named(name, aspect = 1) {
        const [forward, up] = VIEWS[name];
        this.look(forward, up);
        this.target = this.middle;
        this.half = Math.max(this.extent(this.up), this.extent(this.right()) / aspect) * 1.06 || 1;
    }

    /** Turns the camera; directions that make no sense change nothing. */
    look(forward, up) {
        const across = cross(forward, up);
        if (!(Math.hypot(...across) > 1e-6 * Math.hypot(...forward) * Math.hypot(...up))) return;
        this.forward = unit(forward);
        this.up = unit(cross(unit(across), this.forward));
    }

    right() {
        return cross(this.forward, this.up);
    }

    distance() {
        return this.half / Math.tan(FOV / 2 * Math.PI / 180);
    }

    /** Turns about what is looked at: across about the head's axis, along about the picture's horizontal. */
    orbit(across, along) {
        const axis = [0, 0, 1];
        this.look(turned(this.forward, axis, across), turned(this.up, axis, across));
        const forward = turned(this.forward, this.right(), along), up = turned(this.up, this.right(), along);
        if (up[2] >= -1e-6 || Math.abs(this.up[2]) < 1e-6) this.look(forward, up);
    }

    /** Moves by parts of half the picture's height. */
    pan(x, y) {
        this.target = added(added(this.target, this.right(), -x * this.half), this.up, -y * this.half);
    }

    /** Zooms to a point of the picture, -1 to 1 from bottom to top, which stays where it is. */
    zoom(factor, x = 0, y = 0) {
        const half = Math.min(Math.max(this.half * factor, this.reach * 1e-5), this.reach * 100);
        const moved = this.half - half;
        this.target = added(added(this.target, this.right(), x * moved), this.up, y * moved);
        this.half = half;
    }

    /** Origin and direction of the line of sight through a point of the picture, x to the right, y up, -1 to 1. */
    ray(x, y, aspect) {
        const [o, d] = this.lines(aspect);
        return [added(added(o[0], o[1], x), o[2], y), added(added(d[0], d[1], x), d[2], y)];
    }

    /** Origin and direction as affine functions of the picture's point. */
    lines(aspect) {
        const sides = [scaled(this.right(), this.half * aspect), scaled(this.up, this.half)], none = [[0, 0, 0], [0, 0, 0]];
        if (!this.perspective) {
            const back = added(this.target, this.forward, -2 * this.reach - Math.hypot(...added(this.target, this.middle, -1)));
            return [[back, ...sides], [this.forward, ...none]];
        }
        const far = this.distance();
        return [[added(this.target, this.forward, -far), ...none], [this.forward, ...sides.map(side => scaled(side, 1 / far))]];
    }

    /** The plane of the cut: what is kept has n . p >= w, in mm; `null` without one. */
    plane() {
        if (this.cut === 'none') return null;
        let n = [0, 0, 0];
        if (this.cut === 'sight') n = this.forward;
        else n['xyz'.indexOf(this.cut)] = 1;
        const [middle, half] = [dot(n, this.middle), this.extent(n)];
        let w = middle + (2 * this.cutAt - 1) * half * 1.001;
        if (this.flipped) [n, w] = [scaled(n, -1), -w];
        return [n, w];
    }

    /** What the shader wants. */
    inGrid(model, aspect) {
        const point = p => model.toGrid.map(row => dot(row, p) + row[3]), vector = v => model.toGrid.map(row => dot(row, v));
        const [o, d] = this.lines(aspect), plane = this.plane();
        const axes = [this.right(), this.up, scaled(this.forward, -1)];
        // Columns of the product of the camera's axes and the normals' rows.
        const columns = [0, 1, 2].map(j => axes.map(axis => dot(axis, model.normalRows.map(row => row[j]))));
        let cut = [0, 0, 0, 0], cutNormal = [0, 0, 1];
        if (plane) {
            const n = [0, 1, 2].map(j => dot(plane[0], model.toWorld.map(row => row[j])));
            cut = [...n, plane[1] - dot(plane[0], model.toWorld.map(row => row[3]))];
            const length = Math.hypot(...n);
            cut = cut.map(c => c / length);
            cutNormal = axes.map(axis => dot(axis, plane[0]));
        }
        return {
            origin: [point(o[0]), vector(o[1]), vector(o[2])], direction: d.map(vector), normalToCamera: columns, cut, cutNormal,
        };
    }

    /** Is it dark: as was chosen, or else as the system is? */
    get isDark() {
        return this.dark ?? matchMedia('(prefers-color-scheme: dark)').matches;
    }

    get background() {
        return this.isDark ? [[.055, .06, .07, 1], [.11, .12, .14, 1]] : [[.86, .88, .90, 1], [.97, .975, .98, 1]];
    }

    /** The first box under a point of the picture: what `Model.trace` gives with `at` in mm, or `null`. */
    pick(model, x, y, aspect) {
        const [o, d] = this.ray(x, y, aspect), plane = this.plane();
        let least = 0;
        if (plane) {
            const start = dot(plane[0], o) - plane[1], change = dot(plane[0], d);
            if (start < 0 && change <= 0) return null;
            if (start < 0) least = -start / change;
        }
        const point = model.toGrid.map(row => dot(row, o) + row[3]), vector = model.toGrid.map(row => dot(row, d));
        const hit = model.trace(point, vector, least, this.hidden);
        if (!hit) return null;
        // A label that is cut lies at the plane.
        const at = added(o, d, hit.label && hit.isWithin && least ? least : hit.t);
        return plane && dot(plane[0], at) < plane[1] - 1e-6 ? null : {...hit, at};
    }

    /** The state as text for the address. */
    toString() {
        const list = v => v.map(c => +c.toPrecision(7)).join(',');
        const parts = [`f=${list(this.forward)}`, `u=${list(this.up)}`, `t=${list(this.target)}`, `h=${+this.half.toPrecision(7)}`];
        if (this.perspective) parts.push('p=1');
        if (this.cut !== 'none') parts.push(`c=${this.cut},${+this.cutAt.toFixed(4)}${this.flipped ? ',1' : ''}`);
        if (this.dark !== null) parts.push(`d=${+this.dark}`);
        if (!this.colors) parts.push('k=0');
        // Ranges of numbers, between labels that are seen.
        const runs = [];
        this.labels.forEach(({number}, i) => {
            if (!this.hidden[i + 1]) return;
            if (i > 0 && this.hidden[i]) runs.at(-1)[1] = number;
            else runs.push([number, number]);
        });
        if (runs.length) parts.push(`x=${runs.map(([a, b]) => a === b ? a : `${a}..${b}`).join(',')}`);
        return parts.join('&');
    }

    /** Takes the state from an address; what makes no sense is left out. */
    read(text) {
        const given = new URLSearchParams(text.slice(0, 4000));
        const list = name => {
            const numbers = (given.get(name) ?? '').split(',').map(Number);
            return numbers.length === 3 && numbers.every(c => Number.isFinite(c) && Math.abs(c) < 1e12) ? numbers : null;
        };
        if (Object.hasOwn(VIEWS, given.get('v'))) this.named(given.get('v'));
        const [forward, up, target, half] = [list('f'), list('u'), list('t'), Number(given.get('h'))];
        if (forward && up) this.look(forward, up);
        if (target) this.target = target;
        if (half > 0 && half < this.reach * 100) this.half = half;
        this.perspective = given.get('p') === '1';
        this.dark = given.has('d') ? given.get('d') === '1' : null;
        this.colors = given.get('k') !== '0';
        this.hidden.fill(0);
        for (const run of (given.get('x') ?? '').split(',').filter(Boolean)) {
            const [a, b = a] = run.split('..').map(Number);
            this.labels.forEach(({number}, i) => { if (number >= a && number <= b) this.hidden[i + 1] = 1; });
        }
        const [cut, at, flipped] = (given.get('c') ?? 'none').split(',');
        this.cut = CUTS.includes(cut) ? cut : 'none';
        const place = Number(at);
        this.cutAt = place >= 0 && place <= 1 ? place : .5;
        this.flipped = flipped === '1';
    }
}

if (typeof module !== 'undefined') module.exports = {View, VIEWS, CUTS, dot, cross, added, scaled, unit, FOV};
