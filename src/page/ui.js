'use strict';
/* global Drawing, View, VIEWS, CUTS, models, ask, compiled, LABELS, valueOf, dot, cross, added, scaled, SHADER */
// The page: events in, pictures out.

const $ = id => document.getElementById(id);
const framed = self !== top;
const main = document.querySelector('main'), canvas = $('canvas');
const page = {model: null, view: null, drawing: null, asks: false, points: [], scale: 4, fine: null, moving: 0, error: null, saves: false};

function say(text, failed = false) {
    $('said').textContent = text;
    main.classList.toggle('failed', failed);
    if (failed) page.error = text;
}

/** Millimetres as a person reads them. */
function length(mm) {
    const [value, name] = mm >= 1000 ? [mm / 1000, 'm'] : mm >= 0.1 || mm === 0 ? [mm, 'mm'] : [mm * 1000, 'µm'];
    return `${+value.toPrecision(4)} ${name}`;
}

const aspect = () => canvas.width / canvas.height;

/** A point of the picture in pixels of the page, of a point in mm. */
function onPage(at) {
    const view = page.view, from = added(at, view.target, -1);
    const depth = view.perspective ? 1 + dot(from, view.forward) / view.distance() : 1;
    if (!(depth > 0)) return null;
    const [x, y] = [dot(from, view.right()), dot(from, view.up)].map(c => c / view.half / depth);
    return [canvas.offsetLeft + (x / aspect() + 1) / 2 * canvas.clientWidth, canvas.offsetTop + (1 - y) / 2 * canvas.clientHeight];
}

function svg(name, attributes, text) {
    const made = document.createElementNS('http://www.w3.org/2000/svg', name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    return made;
}

/** Lines and numbers of what was measured. */
function drawMarks() {
    const marks = $('marks'), places = page.points.map(point => onPage(point.at));
    marks.replaceChildren();
    for (let i = 1; i < places.length; i++) {
        if (places[i - 1] && places[i]) {
            const [[x1, y1], [x2, y2]] = [places[i - 1], places[i]];
            marks.append(svg('line', {x1, y1, x2, y2}));
        }
    }
    places.filter(Boolean).forEach(([cx, cy]) => marks.append(svg('circle', {cx, cy, r: 4.5})));
    const text = measured(), last = places.at(-1);
    if (text && last) marks.append(svg('text', {x: last[0] + 9, y: last[1] - 9}, text));
    $('clear').hidden = page.points.length === 0;
}

/** What the points measure, `null` while there are too few. */
function measured() {
    const [a, b, c] = page.points.map(point => point.at);
    if ($('tool').value === 'distance' && b) return length(Math.hypot(...added(b, a, -1)));
    if ($('tool').value === 'angle' && c) {
        const [p, q] = [added(a, b, -1), added(c, b, -1)];
        return `${(Math.atan2(Math.hypot(...cross(p, q)), dot(p, q)) * 180 / Math.PI).toFixed(1)}°`;
    }
    return null;
}

function drawScale() {
    // Half the picture's height in pixels is view.half in mm, in perspective where it looks at.
    const mm = 2 * page.view.half / canvas.clientHeight, most = mm * Math.min(160, canvas.clientWidth / 3);
    const power = 10 ** Math.floor(Math.log10(most)), step = [5, 2, 1].find(k => k * power <= most) * power;
    $('scale').style.width = `${step / mm}px`;
    $('scale').firstElementChild.textContent = length(step);
}

function drawCube() {
    const view = page.view, axes = [view.right(), view.up, view.forward];
    const names = page.model.head.patient ? ['R', 'L', 'A', 'P', 'I', 'S'] : ['−x', 'x', '−y', 'y', '−z', 'z'];
    const drawing = svg('svg', {viewBox: '-50 -50 100 100'});
    for (let a = 0; a < 3; a++) {
        for (const sign of [-1, 1]) {
            const n = [0, 0, 0];
            n[a] = sign;
            const facing = -dot(n, view.forward), at = v => [dot(v, axes[0]) * 27, -dot(v, axes[1]) * 27];
            const [x, y] = at(n).map(c => facing > .3 ? c : 1.6 * c);
            if (facing > .02) {
                const [p, q] = [(a + 1) % 3, (a + 2) % 3].map(b => [0, 1, 2].map(i => i === b ? 1 : 0));
                const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([i, j]) => at(added(added(n, p, i), q, j)).join(','));
                drawing.append(svg('polygon', {points: corners.join(' ')}));
            }
            if (facing > .3 || Math.abs(facing) < .1) drawing.append(svg('text', {x, y}, names[2 * a + (sign > 0)]));
        }
    }
    $('cube').replaceChildren(drawing);
}

/** Fits the canvas to the page; true where its size changed. */
function fit() {
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const [w, h] = [canvas.clientWidth, canvas.clientHeight].map(side => Math.max(1, Math.round(side * ratio)));
    if (canvas.width === w && canvas.height === h) return false;
    [canvas.width, canvas.height] = [w, h];
    return true;
}

let asked = 0, written = 0;

/** Puts the state into the address. */
function write() {
    clearTimeout(written);
    written = setTimeout(() => {
        try {
            history.replaceState(null, '', `#${page.view}`);
        } catch { /* a frame without an address */ }
    }, 300);
}

/** A picture of what is seen now: coarse at once, fine when nothing moves. */
function redraw() {
    page.fine = null;
    $('refining').hidden = true;
    delete main.dataset.drawn;
    write();
    if (!asked && (page.drawing || page.asks)) asked = requestAnimationFrame(page.asks ? () => ask(2) : frame);
}

function frame() {
    asked = 0;
    if (!page.drawing) return;
    fit();
    const began = performance.now();
    page.drawing.quick(page.view, page.scale);
    page.pictured ??= performance.now();
    const took = performance.now() - began;
    // Some 25 pictures a second: as many pixels as that allows.
    page.scale = Math.min(16, Math.max(1, page.scale * Math.sqrt(Math.min(4, Math.max(.25, took / 40)))));
    drawMarks();
    drawScale();
    drawCube();
    clearTimeout(page.moving);
    page.moving = setTimeout(refine, 160);
}

/** The fine picture, some draws at a time, until something changes: what waits for the graphics cannot be taken back. */
function refine() {
    if (!page.drawing) return;
    const {gl} = page.drawing, mine = page.fine = refined(page.drawing), bar = $('refining');
    let fence = null, began = 0, draws = 1;
    bar.max = 9 * Math.ceil(canvas.width / 256) * Math.ceil(canvas.height / 256);
    bar.value = 0;
    bar.hidden = false;
    const step = () => {
        if (page.fine !== mine) return;
        const now = performance.now();
        if (!fence || gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED) {
            if (fence) gl.deleteSync(fence);
            draws = Math.max(1, now - began < 20 ? 2 * draws : draws >> 1);
            began = now;
            for (let i = 0; i < draws; i++) {
                bar.value++;
                if (mine.next().done) {
                    page.fine = null;
                    bar.hidden = true;
                    main.dataset.drawn = 'fine';
                    if (page.saves) savePicture();
                    return;
                }
            }
            fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
            gl.flush();
        }
        setTimeout(step);
    };
    step();
}

/** A sharp picture, which takes the still one's place, and a smooth one. */
function *refined(drawing) {
    yield *drawing.fine(page.view, 1);
    if (!page.model.head.coarse) main.classList.remove('waits');
    yield *drawing.fine(page.view, 8);
}

/** The name of a label, or its number. */
const nameOf = ({name, number}) => name || `label ${number}`;

/** The list of labels with their eyes. */
function listParts() {
    const view = page.view, list = $('list'), rows = () => [...list.children];
    const [a, b, c] = page.model.head.affine.map(row => row.slice(0, 3)), ml = Math.abs(dot(a, cross(b, c))) / 1000 / (page.model.head.coarse ?? 1) ** 3;
    const made = (name, text = '') => {
        const element = document.createElement(name);
        element.textContent = text;
        return element;
    };
    $('parts').hidden = !view.labels.length;
    $('parts').open = innerWidth > 600;
    // The list stands beside the model.
    const beside = () => {
        main.classList.toggle('listed', view.labels.length > 0 && $('parts').open);
        fit();
        if ($('named').value) view.named($('named').value, aspect());
    };
    beside();
    $('parts').ontoggle = () => {
        beside();
        redraw();
    };
    $('find').hidden = view.labels.length <= 12;
    view.labels.forEach((part, i) => {
        const row = made('li'), label = made('label'), eye = made('input'), swatch = made('i'), name = made('span');
        eye.type = 'checkbox';
        swatch.style.background = `rgb(${part.color.map(Number)})`;
        name.dir = 'auto';
        name.append(...nameOf(part).match(/[^_]+_*|_+/g).flatMap(piece => [piece, made('wbr')]));
        label.title = `label ${part.number}`;
        label.append(eye, swatch, name, made('small', `${+(part.voxels * ml).toPrecision(3)} ml`));
        row.append(label);
        list.append(row);
        eye.onchange = () => {
            view.hidden[i + 1] = eye.checked ? 0 : 1;
            refresh();
        };
    });
    $('find').oninput = () => {
        const text = $('find').value.trim().toLowerCase();
        rows().forEach((row, i) => { row.hidden = !`${nameOf(view.labels[i])} ${view.labels[i].number}`.toLowerCase().includes(text); });
    };
    // Those that are listed.
    const all = hide => () => {
        rows().forEach((row, i) => { if (!row.hidden) view.hidden[i + 1] = hide; });
        refresh();
    };
    $('all').onclick = all(0);
    $('none').onclick = all(1);
}

/** Puts the view's state into the tools. */
function showState(named = '') {
    const view = page.view;
    $('named').value = named;
    $('projection').value = view.perspective ? 'perspective' : 'parallel';
    $('cut').value = view.cut;
    $('place').value = view.cutAt;
    $('place').hidden = $('flip').hidden = view.cut === 'none';
    $('dark').setAttribute('aria-pressed', view.isDark);
    $('colors').setAttribute('aria-pressed', view.colors);
    document.querySelectorAll('#list input').forEach((eye, i) => { eye.checked = !view.hidden[i + 1]; });
    const labels = view.labels.length, hidden = view.hidden.reduce((sum, is) => sum + is, 0);
    $('count').textContent = hidden ? `${labels - hidden} of ${labels}` : labels;
    main.style.colorScheme = view.isDark ? 'dark' : 'light';
    main.classList.toggle('picks', $('tool').value !== 'pick');
}

function changed(named) {
    main.classList.remove('waits');
    showState(named);
    redraw();
}

/** A change that keeps the named view. */
const refresh = () => changed($('named').value);

/** Where an event is in the picture: x and y from -1 to 1 up, x times the aspect for the zoom. */
function place(x, y) {
    const box = canvas.getBoundingClientRect();
    return [2 * (x - box.left) / box.width - 1, 1 - 2 * (y - box.top) / box.height];
}

function pick(x, y) {
    if (!page.model.texels) return;
    if (page.model.head.coarse) return void say('Positions come with the whole model.');
    const hit = page.view.pick(page.model, x, y, aspect());
    if (!hit) return void say('Nothing is there.');
    const tool = $('tool').value, most = {pick: 1, distance: 2, angle: 3}[tool];
    if (page.points.length >= most) page.points = [];
    page.points.push(hit);
    const digits = Math.max(0, 2 - Math.floor(Math.log10(page.model.spacing)));
    const parts = [`x ${hit.at[0].toFixed(digits)}, y ${hit.at[1].toFixed(digits)}, z ${hit.at[2].toFixed(digits)} mm`];
    const {VALU, MATL} = page.model.sections, {head} = page.model;
    if (hit.voxel >= 0 && VALU) {
        const value = valueOf(page.model, hit.voxel), {name = 'value', unit = ''} = head.quantity ?? {};
        parts.push(value === null ? `no ${name}` : `${name} ${+value.toPrecision(head.quantity ? 4 : 6)} ${unit}`.trim());
    }
    if (hit.label) {
        const label = page.view.labels[hit.label - 1];
        parts.unshift(nameOf(label) + (label.name ? ` (label ${label.number})` : ''));
    }
    if (hit.voxel >= 0 && MATL) parts.push(`part ${MATL[hit.voxel]}`);
    const found = measured();
    say(tool === 'pick' || page.points.length === 1 ? parts.join(', ') : found ? `${tool} ${found}` : `${parts.join(', ')}; one more point`);
    drawMarks();
}

function clearPoints() {
    page.points = [];
    say('');
    drawMarks();
}

function savePicture() {
    const link = document.createElement('a'), still = main.classList.contains('waits') || !page.drawing;
    link.download = `${document.title}.png`;
    page.saves = !still && main.dataset.drawn !== 'fine';
    if (page.saves) return void say('It is saved when it is fine.');
    const give = href => {
        link.href = href;
        link.click();
        say(`Saved as ${link.download}.`);
        setTimeout(() => URL.revokeObjectURL(href), 1000);
    };
    if (still) give($('still').src);
    else canvas.toBlob(blob => give(URL.createObjectURL(blob)));
}

/** Cuts, so that the face looks at the viewer. */
function cutBy(name) {
    const view = page.view;
    Object.assign(view, {cut: name, flipped: false});
    const plane = view.plane();
    view.flipped = !!plane && dot(plane[0], view.forward) < -1e-9;
}

function pointers() {
    const down = new Map();
    let moved = 0, last = null;
    const middle = () => {
        const all = [...down.values()];
        return [0, 1].map(a => all.reduce((sum, p) => sum + p[a], 0) / all.length);
    };
    const spread = () => {
        const [a, b] = [...down.values()];
        return b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
    };
    canvas.addEventListener('pointerdown', event => {
        try {
            canvas.setPointerCapture(event.pointerId);
        } catch { /* a pointer of a test */ }
        if (down.size === 0) moved = 0;
        down.set(event.pointerId, [event.clientX, event.clientY]);
        if (down.size > 1) moved = 99;
        last = [middle(), spread()];
    });
    canvas.addEventListener('pointermove', event => {
        if (!down.has(event.pointerId)) return;
        down.set(event.pointerId, [event.clientX, event.clientY]);
        const [[x, y], apart] = [middle(), spread()], [dx, dy] = [x - last[0][0], y - last[0][1]];
        moved += Math.abs(dx) + Math.abs(dy);
        const unit = 2 / canvas.clientHeight;
        if (down.size > 1 || event.buttons & 6 || event.shiftKey) page.view.pan(dx * unit, -dy * unit);
        else if (moved > 4) page.view.orbit(-dx * unit * 1.6, -dy * unit * 1.6);
        if (down.size > 1 && last[1] > 0 && apart > 0) {
            const [px, py] = place(x, y);
            page.view.zoom(last[1] / apart, px * aspect(), py);
        }
        last = [[x, y], apart];
        if (moved > 4) changed();
    });
    const up = event => {
        if (!down.delete(event.pointerId)) return;
        if (down.size === 0 && moved <= 4 && event.type === 'pointerup' && event.button === 0) pick(...place(event.clientX, event.clientY));
        if (down.size > 0) last = [middle(), spread()];
    };
    canvas.addEventListener('pointerup', up);
    canvas.addEventListener('pointercancel', up);
    canvas.addEventListener('contextmenu', event => event.preventDefault());
    canvas.addEventListener('wheel', event => {
        // Within another page the wheel is that page's until the model was clicked.
        if (framed && document.activeElement !== canvas && !event.ctrlKey) return;
        event.preventDefault();
        const [x, y] = place(event.clientX, event.clientY);
        const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
        page.view.zoom(Math.exp(Math.max(-300, Math.min(300, event.deltaY * lines)) * .0015), x * aspect(), y);
        refresh();
    }, {passive: false});
}

function keys(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches('select, input')) return;
    const view = page.view, step = Math.PI / 24, named = Object.keys(VIEWS)[event.key - 1];
    const arrows = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]}[event.key];
    const plain = {
        '+': () => view.zoom(.85), '=': () => view.zoom(.85), '-': () => view.zoom(1 / .85),
        p: () => { view.perspective = !view.perspective; },
        c: () => cutBy(CUTS[(CUTS.indexOf(view.cut) + 1) % CUTS.length]),
        '[': () => { view.cutAt = Math.max(0, view.cutAt - .02); }, ']': () => { view.cutAt = Math.min(1, view.cutAt + .02); },
        f: () => { view.flipped = !view.flipped; },
        b: () => { view.dark = !view.isDark; },
        l: () => { $('parts').open = !$('parts').open; },
        m: () => {
            const tool = $('tool');
            tool.selectedIndex = (tool.selectedIndex + 1) % tool.options.length;
            clearPoints();
        },
        0: () => {
            Object.assign(view, new View(page.model));
            view.named('front', aspect());
            $('named').value = 'front';
        },
    }[event.key];
    if (event.key === '?') $('help').click();
    else if (event.key === 's') savePicture();
    else if (event.key === 'Escape') clearPoints();
    else if (event.key === 'Enter' && event.target === canvas) pick(0, 0);
    else if (named) {
        view.named(named, aspect());
        changed(named);
    } else if (arrows) {
        if (event.shiftKey) view.pan(arrows[0] * .1, arrows[1] * .1);
        else view.orbit(-arrows[0] * step, arrows[1] * step);
        changed();
    } else if (plain) {
        plain();
        refresh();
    } else return;
    event.preventDefault();
}

function tools() {
    const view = page.view, on = (id, what, does) => $(id).addEventListener(what, () => { does($(id).value); refresh(); });
    on('named', 'change', name => { if (name) view.named(name, aspect()); });
    on('projection', 'change', value => { view.perspective = value === 'perspective'; });
    on('cut', 'change', cutBy);
    on('place', 'input', value => { view.cutAt = +value; });
    on('flip', 'click', () => { view.flipped = !view.flipped; });
    on('tool', 'change', clearPoints);
    on('clear', 'click', clearPoints);
    on('dark', 'click', () => { view.dark = !view.isDark; });
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', refresh);
    on('colors', 'click', () => { view.colors = !view.colors; self.showLegend?.(); });
    $('save').addEventListener('click', savePicture);
    $('help').addEventListener('click', () => {
        $('keys').hidden = !$('keys').hidden;
        $('help').setAttribute('aria-expanded', !$('keys').hidden);
    });
    $('tools').addEventListener('submit', event => event.preventDefault());
    addEventListener('keydown', keys);
    addEventListener('resize', redraw);
    addEventListener('hashchange', () => { view.read(location.hash.slice(1)); changed(); });
    canvas.addEventListener('webglcontextlost', event => {
        event.preventDefault();
        page.drawing = page.fine = page.ready = null;
        main.classList.remove('live');
        say('The graphics were lost for a moment.');
    });
    canvas.addEventListener('webglcontextrestored', begin);
}

const graphics = () => canvas.getContext('webgl2', {antialias: false, depth: false, alpha: false, preserveDrawingBuffer: true});

/** Begins to compile the shader, by a pixel, while the model comes in. */
function warm() {
    const gl = main.classList.contains('asks') ? null : graphics(), labels = !main.classList.contains('plain');
    if (!gl || page.ready?.labels === labels) return;
    page.ready = {...compiled(gl, (labels ? LABELS : '') + SHADER), labels};
    gl.useProgram(page.ready.made);
    gl.viewport(0, 0, 1, 1);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.flush();
}

/** Puts the model into the graphics and shows it. */
function begin() {
    try {
        // A model without boxes is of a server that makes pictures.
        const gl = page.model.texels && graphics();
        if (!gl) throw new Error('This browser has no WebGL2; in another one the model can be turned.');
        main.classList.toggle('plain', !page.model.labels);
        warm();
        const last = page.drawing;
        page.drawing = new Drawing(gl, page.model, SHADER, page.ready);
        last?.drop();
    } catch (error) {
        if (!page.model.head.served) throw error;
        page.asks = true;
    }
    main.classList.toggle('asks', page.asks);
    main.classList.add('live');
    $('colors').hidden = !page.model.sections.COLR && !page.view.labels.length;
    self.showLegend?.();
    fit();
    if (!page.model.head.coarse) say('');
    redraw();
}

/** Shows a model: the first one, or one that is finer. */
function show(model) {
    page.opened = performance.now() - page.began;
    page.model = model;
    if (!page.view) {
        const view = page.view = new View(model), link = location.hash.slice(1), state = link || model.head.start;
        listParts();
        fit();
        view.named('front', aspect());
        if (state) view.read(state);
        // The start is framed for a square.
        if (state && !link) view.half /= Math.min(1, aspect());
        main.classList.toggle('waits', !link && $('still').src.length > 100);
        pointers();
        tools();
        showState(state ? '' : 'front');
    }
    begin();
}

async function open() {
    page.began = performance.now();
    try {
        for await (const model of models(JSON.parse($('head').textContent))) show(model);
    } catch (error) {
        main.classList.toggle('live', !!page.drawing);
        main.classList.remove('waits');
        // What is not a sentence of these scripts is of damaged data.
        say(error.name === 'Error' ? error.message : 'The data of the model are damaged.', true);
    }
    main.dataset.opened = page.error ? 'failed' : 'whole';
}

main.classList.toggle('framed', framed);
warm();
document.addEventListener('DOMContentLoaded', open);
