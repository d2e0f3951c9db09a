'use strict';
// Runs in a page behind its own script: what is seen, picked and pressed, as JSON in an element at the end.
/* global page, main, canvas, $, CAMERAS, SIDE, WHAT, TELL, Model, View, frame, dot */

const wait = ms => new Promise(done => setTimeout(done, ms));

/** Bytes as base64, so that a hundred thousand numbers are short. */
function text(words) {
    const bytes = new Uint8Array(words.buffer, words.byteOffset, words.byteLength);
    let binary = '';
    for (let i = 0; i < bytes.length; i += 8192) binary += String.fromCharCode(...bytes.subarray(i, i + 8192));
    return btoa(binary);
}

/** Boxes, depths and normals of a picture from each camera, and how many picks differ from the picture. */
function pictures() {
    return CAMERAS.map(camera => {
        const view = page.view;
        Object.assign(view, {half: camera.half, target: camera.target, perspective: camera.perspective});
        view.look(camera.forward, camera.up);
        view.hidden.fill(0);
        for (const place of camera.hidden) view.hidden[place] = 1;
        const found = page.drawing.numbers(view, SIDE, SIDE);
        let picks = 0;
        for (let i = 0; i < 500; i++) {
            const [x, y] = [i * 7919 % SIDE, i * 104729 % SIDE];
            const hit = view.pick(page.model, 2 * (x + .5) / SIDE - 1, 1 - 2 * (y + .5) / SIDE, 1);
            const box = hit ? (hit.voxel < 0 ? hit.leaf : hit.voxel + page.model.nodes) + 1 : 0;
            const [drawn, , level] = found.subarray(4 * (y * SIDE + x));
            picks += box !== drawn || (hit?.label ?? 0) !== (level >> 8 & 255);
        }
        return {found: text(found), picks};
    });
}

/** What the list of parts does: eyes, all and none, what is found, the address. */
function parts(key, click, middle) {
    const rows = [...$('list').children], eyes = rows.map(row => row.querySelector('input')), view = page.view;
    key('0');
    const seen = () => page.drawing.numbers(view, 64, 64).reduce((sum, n, i) => sum + (i % 4 === 2 && (n >> 8 & 255) === 1), 0);
    const before = seen();
    eyes[0].click();
    const results = {'an eye hides': before > 0 && seen() === 0 && $('count').textContent === `${rows.length - 1} of ${rows.length}`};
    const state = view.toString(), other = new View(page.model);
    other.read(state);
    results['hidden in the address'] = state.includes('&x=') && other.toString() === state && other.hidden[1] === 1;
    $('find').value = rows[1].textContent.split(' ')[0];
    $('find').dispatchEvent(new Event('input'));
    results.found = rows.filter(row => !row.hidden).length === 1;
    $('none').click();
    results['none of those'] = view.hidden.reduce((sum, is) => sum + is, 0) === 2 && !eyes[1].checked;
    $('find').value = '';
    $('find').dispatchEvent(new Event('input'));
    $('all').click();
    results['all of them'] = view.hidden.every(is => !is) && eyes.every(eye => eye.checked) && seen() === before;
    // A part that is cut lies at the plane.
    Object.assign(view, {cut: 'y', cutAt: .5});
    const hit = view.pick(page.model, 0, 0, 1), [n, w] = view.plane();
    results['a cut part'] = hit.label > 0 && Math.abs(dot(n, hit.at) - w) < 1e-6;
    click(...middle);
    results.named = $('said').textContent.startsWith(rows[hit.label - 1].querySelector('span').textContent);
    results['no markup'] = !document.querySelector('#list b');
    key('0');
    return results;
}

/** What a user does, and what came of it. */
async function events() {
    const box = canvas.getBoundingClientRect(), middle = [box.left + box.width / 2, box.top + box.height / 2];
    const pointer = (kind, x, y, more = {}) =>
        canvas.dispatchEvent(new PointerEvent(kind, {clientX: x, clientY: y, pointerId: 1, button: 0, buttons: 1, bubbles: true, ...more}));
    const key = (name, more = {}) => canvas.dispatchEvent(new KeyboardEvent('keydown', {key: name, bubbles: true, cancelable: true, ...more}));
    const state = () => page.view.toString(), said = () => $('said').textContent;
    const results = {};
    const begin = () => {
        key('0');
        return state();
    };
    const changes = (name, does) => {
        const before = begin();
        does();
        results[name] = state() !== before;
    };
    changes('drag', () => {
        pointer('pointerdown', ...middle);
        pointer('pointermove', middle[0] + 40, middle[1] + 10);
        pointer('pointerup', middle[0] + 40, middle[1] + 10);
    });
    changes('pan', () => {
        pointer('pointerdown', ...middle, {buttons: 2, button: 2});
        pointer('pointermove', middle[0] + 40, middle[1] + 10, {buttons: 2});
        pointer('pointerup', middle[0] + 40, middle[1] + 10, {buttons: 0, button: 2});
    });
    changes('wheel', () => canvas.dispatchEvent(new WheelEvent('wheel', {clientX: middle[0], clientY: middle[1], deltaY: -200, cancelable: true})));
    changes('pinch', () => {
        const two = {pointerId: 2, pointerType: 'touch'};
        pointer('pointerdown', middle[0] - 50, middle[1]);
        pointer('pointerdown', middle[0] + 50, middle[1], two);
        pointer('pointermove', middle[0] + 90, middle[1], two);
        pointer('pointerup', middle[0] + 90, middle[1], two);
        pointer('pointerup', middle[0] - 50, middle[1]);
    });
    for (const name of ['2', 'ArrowLeft', '+', 'p', 'c', 'b']) changes(`key ${name}`, () => key(name));
    results['keys of the browser are left alone'] = !key('s', {ctrlKey: true}) === false;
    begin();
    const click = (x, y) => {
        pointer('pointerdown', x, y);
        pointer('pointerup', x, y, {buttons: 0});
    };
    click(...middle);
    results.picked = said();
    key('m');
    click(...middle);
    click(middle[0] + 20, middle[1] + 5);
    results.distance = said();
    results.marks = $('marks').querySelectorAll('circle').length;
    key('Escape');
    results.cleared = $('marks').childElementCount === 0;
    key('m');
    key('m');
    results.tool = $('tool').value;
    // The address holds the state, and gives it back.
    key('3');
    key('c');
    const before = state(), other = new View(page.model);
    other.read(before);
    results.address = other.toString() === before;
    other.read('f=0,0,0&u=NaN&t=1e99,0,0&h=-5&c=w,9&p=x');
    results['an address without sense'] = other.toString() !== '' && Number.isFinite(other.half);
    const small = canvas.width;
    canvas.style.width = '300px';
    window.dispatchEvent(new Event('resize'));
    frame();
    results.resize = canvas.width !== small;
    canvas.style.width = '';
    if (page.model.labels) Object.assign(results, parts(key, click, middle));
    // Names for those who do not see, and nothing without one.
    const controls = [...document.querySelectorAll('select, button, input, canvas')];
    results.unnamed = controls.filter(c => !(c.getAttribute('aria-label') || c.closest('label') || c.textContent.trim())).length;
    // The graphics are lost, and come back.
    const lose = page.drawing.gl.getExtension('WEBGL_lose_context');
    lose.loseContext();
    await wait(300);
    results.lost = !main.classList.contains('live');
    lose.restoreContext();
    await wait(600);
    results.restored = main.classList.contains('live') && page.drawing.numbers(page.view, 8, 8).some(n => n > 0);
    return results;
}

/** Damaged sections: each is refused with a sentence, or rays through it end. */
function damaged() {
    let seed = 12345, refused = 0, opened = 0, met = 0;
    const sound = {NODE: Uint8Array.from({length: page.model.nodes}, (_, node) => page.model.infobyte(node)), ...page.model.sections};
    const random = n => {
        seed = Math.imul(seed, 1664525) + 1013904223 >>> 0;
        return seed % n;
    };
    for (let round = 0; round < 400; round++) {
        const sections = Object.fromEntries(Object.entries(sound).map(([kind, bytes]) => [kind, bytes.slice()]));
        const head = structuredClone(page.model.head), kinds = Object.keys(sections);
        for (let change = 0; change <= random(4); change++) {
            const kind = kinds[random(kinds.length)], bytes = sections[kind];
            if (round % 3 === 0 && bytes.length > 1) {
                // Counts stay what they are.
                const [a, b] = [random(bytes.length), random(bytes.length)];
                [bytes[a], bytes[b]] = [bytes[b], bytes[a]];
            } else if (round % 3 === 1) bytes[random(bytes.length)] = random(256);
            else sections[kind] = bytes.slice(0, random(bytes.length));
        }
        if (round % 20 === 19) head[['depth', 'nodes', 'voxels'][random(3)]] = random(2 ** 31);
        try {
            const model = new Model(head, sections);
            opened++;
            for (let i = 0; i < 20; i++) {
                const p = [0, 1, 2].map(() => random(1000) / 500 * 2 ** head.depth - .5 * 2 ** head.depth);
                met += model.trace(p, [0, 1, 2].map(a => random(1000) / 1000 * 2 ** head.depth - p[a])) !== null;
            }
        } catch (error) {
            if (!(error instanceof Error) || !error.message || error instanceof TypeError) throw error;
            refused++;
        }
    }
    return {refused, opened, met};
}

(async () => {
    let result;
    try {
        while (!main.dataset.opened) await wait(10);
        result = {error: page.error};
        if (!page.error) {
            result.pictures = pictures();
            if (WHAT === 'events') {
                result.damaged = damaged();
                result.events = await events();
            }
        }
    } catch (error) {
        result = {threw: String(error.stack ?? error)};
    }
    // Where a browser does not print its page.
    if (TELL) return void fetch(TELL, {method: 'POST', mode: 'no-cors', body: JSON.stringify(result)});
    const shown = document.createElement('pre');
    shown.id = 'result';
    shown.textContent = JSON.stringify(result);
    document.body.append(shown);
})();
