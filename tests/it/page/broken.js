'use strict';
// Damaged models in a page that is open: what its scripts make of them, up to the picture.
/* global page, decoded, sections, Model, Drawing, View, SHADER, KEPT, HEAD */

/** Changes bytes in one of some ways; gives what is left of them. */
function damaged(bytes, random) {
    const at = () => random(bytes.length);
    if (!bytes.length) return bytes;
    switch (random(5)) {
        case 0: bytes[at()] = random(256); break;
        case 1: bytes[at()] ^= 1 << random(8); break;
        // Counts stay what they are.
        case 2: for (let i = 0; i <= random(40); i++) { const [a, b] = [at(), at()]; [bytes[a], bytes[b]] = [bytes[b], bytes[a]]; } break;
        case 3: { const [a, b] = [at(), at()].sort((p, q) => p - q); bytes.subarray(a, b).reverse(); break; }
        default: return bytes.slice(0, at());
    }
    return bytes;
}

/** Opens so many damaged models; how many were refused and opened, and sentences that are none. */
async function broken(rounds, seed) {
    const random = n => {
        seed = Math.imul(seed ^ seed >>> 15, 0x2c1b3c6d) + 0x9e3779b9 | 0;
        return (seed >>> 8) % n;
    };
    const result = {refused: 0, opened: 0, met: 0, longest: 0, sentences: {}, strange: []}, {gl} = page.drawing;
    for (let round = 0; round < rounds; round++) {
        const began = performance.now();
        let head = HEAD, chunks = KEPT.map(decoded);
        const kind = round % 4;
        if (kind === 0) chunks = chunks.map(chunk => damaged(chunk, random));
        if (kind === 1) {
            const digits = [...head.matchAll(/\d+/g)], [{0: text, index}] = [digits[random(digits.length)]];
            head = head.slice(0, index) + [0, 1, 255, 2 ** 31, 2 ** 53, -1, 'null', '""'][random(8)] + head.slice(index + text.length);
        }
        try {
            head = JSON.parse(head);
            const found = await sections(head, chunks);
            if (kind > 1) for (let i = 0; i <= random(3); i++) {
                const kinds = Object.keys(found), one = kinds[random(kinds.length)];
                found[one] = damaged(found[one], random);
            }
            const model = new Model(head, found), drawing = new Drawing(gl, model, SHADER), view = new View(model);
            drawing.programs = page.drawing.programs;
            view.look([random(9) - 4, random(9) - 4, random(9) - 4.5], [0, 0, 1]);
            result.met += drawing.numbers(view, 48, 48).some(n => n > 0);
            for (let i = 0; i < 5; i++) view.pick(model, random(100) / 50 - 1, random(100) / 50 - 1, 1);
            Object.values(drawing.textures).forEach(texture => gl.deleteTexture(texture));
            result.opened++;
        } catch (error) {
            result.refused++;
            const sentence = error.name === 'Error' ? error.message.replace(/\d+/g, 'N') : error.name;
            result.sentences[sentence] = (result.sentences[sentence] ?? 0) + 1;
        }
        if (gl.isContextLost()) result.strange.push(`round ${round}: the graphics are lost`);
        result.longest = Math.max(result.longest, performance.now() - began);
    }
    return result;
}
