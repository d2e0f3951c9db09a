'use strict';
/* global $, Model, Drawing, SHADER, BITS, page, canvas, say */
// The model of a file on the page's own server, which is fetched in parts: coarse first, by servers without ranges, too.

/** Bytes that are fetched first; of coarse models at most; of normals that are fetched at once; and of a model. */
const FIRST = 1 << 16, COARSE = [2.5e5, 2.5e6], FEW = 1e6, MOST = 400 * 2 ** 20;

const CHANGED = 'has changed: load the page again.', CRCS = Uint32Array.from({length: 256}, (_, sum) => {
    for (let i = 0; i < 8; i++) sum = sum >>> 1 ^ (sum & 1 && 0x82f63b78);
    return sum;
});

/** CRC-32C. */
function crc(bytes) {
    let sum = -1;
    for (let i = 0; i < bytes.length; i++) sum = sum >>> 8 ^ CRCS[(sum ^ bytes[i]) & 255];
    return ~sum >>> 0;
}

/** A file of the server. `stream` and `whole` are of one that the server gives only as a whole. */
class Remote {
    constructor(name) {
        if (!name) throw new Error('Which model? Add ?model=NAME.oct.');
        if (location.protocol === 'file:') throw new Error(`Opened as a file, a page may read no other: oct view shows ${name}, as does a web server.`);
        const url = new URL(name, location.href);
        if (url.origin !== location.origin) throw new Error('A page shows models of its own server only.');
        Object.assign(this, {name, url, total: FIRST, came: 0, due: 0});
    }

    refuse(why) {
        throw new Error(`${this.name} ${why}`);
    }

    async ask(from, to) {
        const answer = await fetch(this.url, {headers: {Range: `bytes=${from}-${to - 1}`}, cache: 'no-cache', mode: 'same-origin'})
            .catch(() => this.refuse('cannot be fetched: no answer.'));
        const {status, headers} = answer;
        if (status !== 200 && status !== 206) this.refuse(status === 404 ? 'is not on the server.' : `is refused: ${status}.`);
        const tag = headers.get('ETag') ?? headers.get('Last-Modified') ?? '', range = /^bytes (\d+)-(\d+)\/(\d+)$/.exec(headers.get('Content-Range'));
        this.tag ??= tag;
        if (range) this.length ??= +range[3];
        if (tag !== this.tag || range && +range[3] !== this.length) this.refuse(CHANGED);
        if (status === 206 && !(range && +range[1] === from && +range[2] === Math.min(to, this.length) - 1)) this.refuse('came in a wrong part.');
        return {reader: answer.body.getReader(), rest: new Uint8Array(0), at: 0, isWhole: status === 200};
    }

    /** Takes what comes in, up to some place. */
    async fill(stream, bytes, to) {
        if (to > bytes.length) this.refuse('is too large without ranges.');
        while (stream.at < to) {
            if (!stream.rest.length) {
                const {done, value} = await stream.reader.read().catch(() => ({done: true}));
                if (done) return;
                stream.rest = value;
            }
            const some = stream.rest.subarray(0, bytes.length - stream.at), tenths = () => Math.floor(10 * this.came / this.due), before = tenths();
            bytes.set(some, stream.at);
            stream.rest = stream.rest.subarray(some.length);
            stream.at += some.length;
            this.came += some.length;
            if (tenths() > before) say(`Opening the model: ${Math.min(10 * tenths(), 100)} % of ${(this.due / 1e6).toFixed(1)} MB`);
        }
    }

    async bytes(from, count) {
        const to = from + count;
        if (to <= this.first?.length) return this.first.subarray(from, to);
        let stream = this.stream, bytes = this.whole, end = to;
        if (!stream) {
            stream = await this.ask(from, to);
            bytes = new Uint8Array(stream.isWhole ? this.total : count);
            if (stream.isWhole) [this.stream, this.whole] = [stream, bytes];
            else end = count;
        }
        await this.fill(stream, bytes, end);
        if (!this.first) return bytes.subarray(0, stream.at);
        if (stream.at < end) this.refuse('is cut short.');
        return stream.isWhole ? bytes.subarray(from, to) : bytes;
    }

    /** Reads the head of the file: `sections` by their kinds, and fields of the header. */
    async open() {
        const bytes = this.first = await this.bytes(0, FIRST), {length} = bytes, view = viewOf(bytes);
        const word = at => view.getUint32(at, true), long = at => Number(view.getBigUint64(at, true));
        const table = length < 64 ? 64 : 64 + 48 * view.getUint16(14, true);
        if (length < table || word(0) !== 0x54434f89 || word(4) !== 0x0a1a0a0d) this.refuse('is not a model, or cut short.');
        if (crc(bytes.subarray(0, 60)) !== word(60) || crc(bytes.subarray(64, table)) !== word(56)) this.refuse('is damaged.');
        if (bytes[12] & 1) this.refuse('is packed: use oct unpack.');
        if (bytes[8] !== 1 || ![0, 2, 6, 10].includes(bytes[12])) this.refuse('is newer than this page.');
        this.total = long(16);
        if ((this.length ?? this.total) !== this.total || this.total < length) this.refuse('is cut short.');
        this.sections = {};
        for (let at = 64; at < table; at += 48) {
            const kind = String.fromCharCode(...bytes.subarray(at, at + 4));
            this.sections[kind] = {from: long(at + 8), count: long(at + 24), items: long(at + 32), size: bytes[at + 5], crc: word(at + 44)};
            if (bytes[at + 4] || long(at + 8) + long(at + 24) > this.total) this.refuse('is damaged.');
        }
        if (this.whole && this.total <= MOST) {
            this.whole = new Uint8Array(this.total);
            this.whole.set(bytes);
        }
        return {depth: bytes[13], nodes: long(24), voxels: long(32), cells: bytes[12] > 0, dims: [40, 44, 48].map(word)};
    }

    /** A section, which is what it was when it was written. */
    async section(kind) {
        const {from, count, crc: sum} = this.sections[kind] ?? this.refuse(`has no section ${kind}.`);
        const bytes = await this.bytes(from, count);
        if (crc(bytes) !== sum) this.refuse(`is damaged, or ${CHANGED}`);
        return bytes;
    }
}

const viewOf = bytes => new DataView(bytes.buffer, bytes.byteOffset, bytes.length);

/** The numbers and texts of a record, one after the other. */
function record(bytes) {
    const view = viewOf(bytes);
    let at = 0;
    const take = count => (at += count) - count, long = () => Number(view.getBigUint64(take(8), true));
    return {
        take, long, byte: () => view.getUint8(take(1)), half: () => view.getUint16(take(2), true), double: () => view.getFloat64(take(8), true),
        text: () => {
            const count = long(), from = take(count);
            return new TextDecoder().decode(bytes.subarray(from, from + count));
        },
    };
}

/** Adds what the metadata say to the head: the affine of boxes, the scale of values, the labels. */
async function described(file, head) {
    const meta = record(await file.section('META')), {sections} = file;
    meta.text();
    const format = meta.text();
    meta.text();
    meta.take(16 + 12 + 1 + 24);
    head.affine = [0, 1, 2].map(() => [0, 1, 2, 3].map(meta.double));
    if (head.cells) head.affine = moved(head.affine, 1, -.5);
    meta.take(16 + 17 + 1);
    meta.text();
    head.value_scale = [meta.double(), meta.double()];
    head.value_bytes = sections.VALU?.size ?? 0;
    head.patient = ['dicom', 'nifti', 'nrrd', 'metaimage'].includes(format);
    head.leaves = sections.LNRM?.items ?? 0;
    if (!sections.LTAB) return;
    const table = record(await file.section('LTAB'));
    head.labels = Array.from({length: Math.min(table.long(), 16384)}, () => {
        const label = {number: table.half(), color: [table.byte(), table.byte(), table.byte()]};
        table.take(1);
        return {...label, voxels: table.long(), name: table.text()};
    });
}

/** An affine of boxes that are larger, and begin elsewhere. */
const moved = (affine, size, by) => affine.map(([x, y, z, t]) => [x * size, y * size, z * size, t + by * (x + y + z)]);

/** Labels of cells, behind and in front, by their places in the table. */
function labelsOf(bytes, {voxels}) {
    const view = viewOf(bytes), found = new Uint8Array(2 * voxels);
    for (let first = 0, block = 0, at = 0; first < voxels; first += 64, block++) {
        const entry = 16 * (block >> 3), count = Math.min(64, voxels - first);
        if (!(block & 7)) at = Number(view.getBigUint64(entry, true));
        const palette = bytes[entry + 8 + (block & 7)], bits = palette < 2 ? 0 : palette < 3 ? 1 : palette < 5 ? 2 : 4, codes = at + 2 * palette;
        for (let i = 0; i < count; i++) {
            const place = palette ? bytes[codes + (i * bits >> 3)] >> (i * bits & 7) & (1 << bits) - 1 : i;
            const code = view.getUint16(at + 2 * place, true);
            found.set([code, code >> 8], 2 * (first + i));
        }
        at = codes + Math.ceil((palette ? bits : 16) * count / 8);
    }
    return found;
}

/** Items of cells between more than two labels, as textures have them. */
function wallsOf(bytes, places) {
    const items = bytes.length / 20, view = viewOf(bytes), found = new Uint8Array(16 * items);
    for (let i = 0; i < items; i++) {
        for (let k = 0; k < 8; k++) found[16 * i + k] = places.get(view.getUint16(20 * i + 2 * k, true));
        found.set(bytes.subarray(20 * i + 16, 20 * i + 20), 16 * i + 8);
    }
    return found;
}

/** Least and greatest corner of the boxes in the grid, by those of the first depth that has many. */
Model.prototype.extent = function () {
    const {depth} = this, low = [Infinity, Infinity, Infinity], high = [0, 0, 0];
    let boxes = [[0, 0, 0]], size = 2 ** depth, at = 0;
    for (let isLast = false; !isLast; size /= 2) {
        isLast = size === 1 || boxes.length > 1e5;
        boxes = boxes.flatMap(box => {
            const infobyte = isLast ? 0 : this.infobyte(at++);
            if (!infobyte) box.forEach((c, a) => { [low[a], high[a]] = [Math.min(low[a], c), Math.max(high[a], c + size)]; });
            return [...'01234567'].filter(i => infobyte >> i & 1).map(i => box.map((c, a) => c + (i >> a & 1) * size / 2));
        });
    }
    return [low, high];
};

/** The same model with boxes of a depth as its finest; these are full. */
async function coarse(file, head, levels, depth, nodes) {
    const {NLOD, LNRM, LOFS} = file.sections, count = levels[depth + 1] - levels[depth], size = 2 ** (head.depth - depth);
    const part = async ({from}, first, bytes) => (await file.bytes(from + first, bytes)).slice(), sections = {NODE: nodes, NORM: NLOD && await part(NLOD, 2 * levels[depth], 2 * count)};
    let leaves = 0;
    if (head.cells) Object.assign(sections, {OFFS: new Uint8Array(count).fill(127), CORN: new Uint8Array(0)});
    if (head.leaves) {
        leaves = nodes.reduce((sum, infobyte) => sum + !infobyte, 0);
        Object.assign(sections, {LNRM: await part(LNRM, 0, 2 * leaves), LOFS: await part(LOFS, 0, leaves)});
    }
    const affine = moved(head.affine, size, (size - 1) / 2), dims = head.dims.map(c => Math.ceil(c / size));
    return new Model({...head, coarse: size, depth, nodes: levels[depth], voxels: count, leaves, affine, dims}, sections);
}

/**
 * Fetches of the normals of voxels those first that are seen, and gives the model with them; what is not seen has those
 * of boxes of four voxels until it comes, too. A view needs a third of the normals or more, but most of the nodes.
 */
async function *seenFirst(file, head, first, NODE) {
    const {NORM} = file.sections, means = await file.section('NLOD'), normals = new Uint8Array(NORM.count), {nodes, depth} = head;
    head = {...head, coarse: 1};
    const drawing = new Drawing(page.drawing.gl, new Model(head, {NODE}), SHADER), shown = drawing.numbers(page.view, 512, Math.ceil(512 * canvas.height / canvas.width));
    drawing.drop();
    // Descendants of boxes follow each other.
    for (let box = first[depth - 2], node = first[depth - 1], voxel = 0; box < Math.min(first[depth - 1], nodes); box++) {
        for (let i = BITS[NODE[box]]; i > 0; i--) {
            for (let k = BITS[NODE[node++]]; k > 0; k--) normals.set(means.subarray(2 * box, 2 * box + 2), 2 * voxel++);
        }
    }
    const part = 2 * Math.ceil(NORM.count / 1024), parts = new Uint8Array(Math.ceil(NORM.count / part));
    for (let i = 0; i < shown.length; i += 4) if (shown[i]) parts[Math.floor(2 * (shown[i] - 1 - nodes) / part)] = 1;
    for (const isSeen of [1, 0]) {
        const waited = [];
        for (let from = 0, to = 0; from < parts.length; from = to) {
            while (parts[to] === parts[from]) to++;
            const place = from * part;
            if (parts[from] === isSeen) waited.push(file.bytes(NORM.from + place, Math.min(to * part, NORM.count) - place).then(bytes => normals.set(bytes, place)));
        }
        await Promise.all(waited);
        if (isSeen) yield new Model(head, {NODE, NORM: normals});
    }
    if (crc(normals) !== NORM.crc) file.refuse(`is damaged, or ${CHANGED}`);
    return normals;
}

/** Models of the file that the page's address or head names: coarse ones, then the whole. */
async function *models({model}) {
    const name = new URLSearchParams(location.search).get('model') ?? model;
    // The picture is of the page's own model.
    $('still').hidden = !model || name !== model;
    const file = new Remote(name), head = await file.open();
    document.title = file.name.replace(/^.*\//, '').replace(/\.oct$/i, '');
    await described(file, head);
    const kinds = 'NODE NORM OFFS CORN LABL COLR VALU MATL LNRM LOFS'.split(' ').filter(kind => file.sections[kind] && (head.cells || kind !== 'OFFS'));
    file.due = kinds.reduce((sum, kind) => sum + file.sections[kind].count, 0);
    const levels = record(await file.section('LEVL')), first = Array.from({length: head.depth + 1}, levels.long);
    const {NODE, NLOD} = file.sections, nodes = new Uint8Array(Math.min(NODE.count, MOST));
    const early = file.first.subarray(NODE.from, NODE.from + nodes.length);
    nodes.set(early);
    let have = early.length, sharpest = 0;
    const nodesTo = async end => {
        if (end > have) nodes.set(await file.bytes(NODE.from + have, end - have), have);
        have = Math.max(have, end);
        return nodes.subarray(0, end);
    };
    const tooMany = head.labels?.length > 255, isLarge = file.due > MOST || tooMany;
    for (const most of [...COARSE, ...isLarge ? [MOST / 8] : []]) {
        if (head.cells && !NLOD) continue;
        const cost = depth => first[depth] + 2 * (first[depth + 1] - first[depth]);
        let depth = head.depth - 2;
        while (depth > 0 && cost(depth) > Math.min(most, file.due / 8)) depth--;
        if (depth <= sharpest) continue;
        sharpest = depth;
        yield await coarse(file, head, first, depth, await nodesTo(first[depth]));
    }
    if (isLarge) file.refuse(`has ${tooMany ? head.labels.length + ' labels' : (file.due >> 20) + ' MiB'}, too many for a page: oct view shows it.`);
    const sections = {NODE: await nodesTo(NODE.count)};
    if (crc(nodes) !== NODE.crc) await file.section('NODE');
    if (!head.cells && NLOD && file.sections.NORM.count > FEW && !file.stream && page.drawing) sections.NORM = yield* seenFirst(file, head, first, sections.NODE);
    for (const kind of kinds.slice(1)) sections[kind] ??= await file.section(kind);
    if (head.labels) {
        const places = new Map(head.labels.map(({number}, i) => [number, i + 1]));
        sections.LABL = labelsOf(sections.LABL, head);
        if (head.cells) sections.CORN = wallsOf(sections.CORN, places);
    }
    yield new Model(head, sections);
}
