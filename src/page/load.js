'use strict';
// The bytes of the page's model: sections that the exporter stored by `deflate`.

/** Bytes of base64. */
function decoded(text) {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const binary = atob(text), bytes = new Uint8Array(binary.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
    return bytes;
}

/** What a zlib stream holds; throws where it is damaged or longer than stated. */
async function inflated(parts, bytes) {
    const stream = new Blob(parts).stream().pipeThrough(new DecompressionStream('deflate')).getReader();
    const whole = new Uint8Array(bytes);
    for (let at = 0; ;) {
        const {done, value} = await stream.read();
        if (done && at < bytes) throw new Error('the data of this page are cut short');
        if (done) return whole;
        if (at + value.length > bytes) throw new Error('the data of this page are damaged');
        whole.set(value, at);
        at += value.length;
    }
}

/** Undoes what made items smaller: bytes of the same place one after the other, each less the one before. */
function merged(bytes, size) {
    const items = bytes.length / size, whole = size === 1 ? bytes : new Uint8Array(bytes.length);
    for (let plane = 0; plane < size; plane++) {
        let last = 0;
        for (let i = 0, from = plane * items, to = plane; i < items; i++, from++, to += size) whole[to] = last = last + bytes[from] & 255;
    }
    return whole;
}

/** Sections by kind. `head.sections` says what is stored one after the other in `chunks`. */
async function sections(head, chunks) {
    const found = {};
    let [chunk, at] = [0, 0];
    for (const {kind, bytes, stored, planes} of head.sections) {
        if (![bytes, stored, planes].every(n => Number.isSafeInteger(n) && n >= 0) || bytes > 2 ** 33 || bytes > 1100 * stored) {
            throw new Error('the head of the model makes no sense');
        }
        const parts = [];
        for (let left = stored; left > 0;) {
            if (chunk >= chunks.length) throw new Error('the data of this page are cut short');
            const part = chunks[chunk].subarray(at, at + left);
            parts.push(part);
            left -= part.length;
            at += part.length;
            if (at === chunks[chunk].length) [chunk, at] = [chunk + 1, 0];
        }
        const content = await inflated(parts, bytes);
        found[kind] = planes ? merged(content, planes) : content;
    }
    return found;
}

if (typeof module !== 'undefined') module.exports = {decoded, sections, merged};
