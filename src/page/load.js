'use strict';
/* global Model, placed, valueOf, page, $ */
// The bytes of the page's model: sections that the exporter stored by `deflate`.

/** Bytes of base64. */
function decoded(text) {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const binary = atob(text), bytes = new Uint8Array(binary.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
    return bytes;
}

/** Lets go of bytes now, without waiting for the browser to look what is still needed: posts them where none receives. */
const drop = bytes => bin.port1.postMessage(0, [bytes.buffer]);
const bin = new MessageChannel();
bin.port2.close();

/** The bytes of parts one after the other, up to so many at a time; those before are let go. */
function reader(parts) {
    let bytes = new Uint8Array(0), at = 0;
    return most => {
        while (at === bytes.length) {
            drop(bytes);
            if (!parts.length) throw new Error('the data of this page are cut short');
            [bytes, at] = [parts.shift(), 0];
        }
        const some = bytes.subarray(at, at + most);
        at += some.length;
        return some;
    };
}

/**
 * The items of a section, of which `next` gives the zlib stream: bytes of the same place one after the other, each less
 * the one before. Throws where the stream is damaged or longer than stated.
 */
async function inflated(next, {bytes, stored, planes}) {
    let left = stored;
    const pull = to => {
        const some = left > 0 ? next(left) : null;
        if (!some) return to.close();
        left -= some.length;
        to.enqueue(some);
    };
    const stream = new ReadableStream({pull}, {highWaterMark: 0}).pipeThrough(new DecompressionStream('deflate')).getReader();
    const whole = new Uint8Array(bytes), size = planes || 1;
    for (let at = 0, to = 0, plane = 0, last = 0; ;) {
        const {done, value} = await stream.read();
        if (done && at < bytes) throw new Error('the data of this page are cut short');
        if (done) return whole;
        if (at + value.length > bytes) throw new Error('the data of this page are damaged');
        if (!planes) whole.set(value, at);
        at += value.length;
        for (let i = 0; planes && i < value.length; i++, to += size) {
            if (to >= bytes) [to, last] = [++plane, 0];
            whole[to] = last = last + value[i] & 255;
        }
        drop(value);
    }
}

/** Sections by kind. `head.sections` says what is stored one after the other in `parts`. */
async function sections(head, parts) {
    const found = {}, next = reader(parts);
    for (const section of head.sections) {
        const {kind, bytes, stored, planes} = section;
        if (![bytes, stored, planes].every(n => Number.isSafeInteger(n) && n >= 0) || bytes > 2 ** 33 || bytes > 1100 * stored || planes && bytes % planes) {
            throw new Error('the head of the model makes no sense');
        }
        found[kind] = await inflated(next, section);
    }
    return found;
}

/** Bytes of the page's parts, which are taken out of it as they come in; the text of all would be in memory twice. */
const came = [];

function take() {
    for (const part of document.querySelectorAll('[data-part]')) {
        if (!part.nextSibling && document.readyState === 'loading') return;
        part.remove();
        try {
            came.push(decoded(part.textContent));
        } catch {
            // The section that needs them says it.
            came.push(new Uint8Array(0));
        }
    }
}

if (typeof document !== 'undefined') new MutationObserver(take).observe(document.body, {childList: true});

/** The model of the page; its place alone, where pictures of it come from a server. */
async function *models(head) {
    take();
    if (!head.sections.length) return void (yield placed(head));
    const found = await sections(head, came), model = new Model(head, found);
    if (head.quantity && found.VALU) model.sections.COLR = colored(model);
    // The model has them in texels.
    drop(found.NODE);
    yield model;
}

/** Red, green and blue of each box, by its value. */
function colored(model) {
    const {range: [low, high], colors, none} = model.head.quantity, made = new Uint8Array(3 * model.voxels);
    for (let box = 0; box < model.voxels; box++) {
        const value = valueOf(model, box), part = Math.min(1, Math.max(0, (value - low) / (high - low)));
        const color = value === null ? none : colors[Math.round(part * (colors.length - 1))];
        for (let i = 0; i < 3; i++) made[3 * box + i] = color[i];
    }
    return made;
}

/** Shows which colour stands for which value. */
function showLegend() {
    if (!page.model.head.quantity) return;
    const {name, unit, sign, range: [low, high], colors} = page.model.head.quantity, [bar, ticks, text] = $('legend').children;
    $('legend').hidden = !page.view.colors;
    bar.style.background = `linear-gradient(to right, ${colors.map(color => `rgb(${color})`)})`;
    [...ticks.children].forEach((tick, i) => {
        // Values beyond the ends have the colours of the ends.
        const beyond = i > 1 ? '≥ ' : low && !i ? '≤ ' : '';
        tick.textContent = beyond + +(low + i / 2 * (high - low)).toPrecision(3);
    });
    text.textContent = `${name}, ${unit}${sign && ` (${sign})`}`;
}

if (typeof module !== 'undefined') module.exports = {decoded, sections};
