'use strict';
/* global Model */
// The model in textures, and pictures of it by WebGL2.

const WIDTH = 4096;

/** A program of a shader that is drawn over the whole picture; it is compiled meanwhile, until it is used. */
function compiled(gl, text) {
    const made = gl.createProgram();
    const add = (kind, text) => {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, '#version 300 es\n' + text);
        gl.compileShader(shader);
        gl.attachShader(made, shader);
        return shader;
    };
    add(gl.VERTEX_SHADER, 'void main(){gl_Position=vec4(gl_VertexID==1?3.:-1.,gl_VertexID==2?3.:-1.,0,1);}');
    const fragment = add(gl.FRAGMENT_SHADER, text);
    gl.linkProgram(made);
    return {made, fragment};
}

const LABELS = '#define LABELS\n';

class Drawing {
    /** Puts a model into the textures of a context; throws where the machine cannot hold it. `ready` is its program. */
    constructor(gl, model, shaders, ready) {
        Object.assign(this, {gl, model, shaders, ready, programs: {}, textures: {}, framebuffer: gl.createFramebuffer()});
        const rows = gl.getParameter(gl.MAX_TEXTURE_SIZE);
        const s = model.sections, put = (name, bytes) => this.put(name, bytes, rows);
        put('nodes', model.texels);
        put('normals', s.NORM);
        put('offsets', model.cells ? s.OFFS : null);
        put('cornerBits', model.corners);
        put('corners', model.corners ? s.CORN : null);
        put('colors', s.COLR);
        if (model.labels) {
            put('labels', s.LABL);
            put('labelColors', Uint32Array.from([{color: [0, 0, 0]}, ...model.labels].flatMap(({color: [r, g, b]}) => [r, g, b, 0])));
        }
        put('leafBits', model.leaves);
        put('leafNormals', model.leaves ? s.LNRM : null);
        put('leafOffsets', model.leaves ? s.LOFS : null);
        this.vertices = gl.createVertexArray();
        this.sum = gl.getExtension('EXT_color_buffer_float') ? gl.RGBA16F : gl.RGBA8;
        this.target = null;
    }

    /** Gives back what it has of the graphics. */
    drop() {
        for (const texture of [...Object.values(this.textures), this.target?.texture ?? null]) this.gl.deleteTexture(texture);
    }

    put(name, data, most) {
        const gl = this.gl, bytes = data ? new Uint8Array(data.buffer, data.byteOffset, data.byteLength) : new Uint8Array(0);
        const texels = Math.max(1, Math.ceil(bytes.length / 16)), rows = Math.ceil(texels / WIDTH);
        if (rows > most) throw new Error(`this machine draws models up to ${(most * WIDTH * 16) >> 20} MiB a section; ${name} has ${bytes.length >> 20}`);
        this.textures[name] = gl.createTexture();
        gl.bindTexture(gl.TEXTURE_2D, this.textures[name]);
        for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
        gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, Math.min(texels, WIDTH), rows);
        const whole = Math.floor(bytes.length / 16 / WIDTH), rest = texels - whole * WIDTH;
        const send = (row, width, words) => {
            gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, row, width, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, words);
        };
        // A row at a time, and a look at every fourth, which waits for it: so that no second copy of everything is held.
        gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
        gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.textures[name], 0);
        for (let row = 0; row < whole; row++) {
            if (row % 4 === 0) gl.readPixels(0, 0, 1, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, new Uint32Array(4));
            send(row, WIDTH, new Uint32Array(bytes.buffer, bytes.byteOffset + 16 * row * WIDTH, 4 * WIDTH));
        }
        if (rest > 0) {
            const last = new Uint8Array(16 * rest);
            last.set(bytes.subarray(16 * whole * WIDTH));
            send(whole, rest, new Uint32Array(last.buffer));
        }
    }

    program(numbers) {
        const name = numbers ? 'numbers' : 'picture';
        if (this.programs[name]) return this.programs[name];
        const gl = this.gl, defines = (numbers ? '#define NUMBERS\n' : '') + (this.model.labels ? LABELS : '');
        const {made, fragment} = !numbers && this.ready || compiled(gl, defines + this.shaders);
        this.ready = numbers ? this.ready : null;
        if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) {
            throw new Error(gl.getShaderInfoLog(fragment) || gl.getProgramInfoLog(made));
        }
        const places = {};
        const count = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS);
        for (let i = 0; i < count; i++) {
            const {name} = gl.getActiveUniform(made, i);
            places[name.replace('[0]', '')] = gl.getUniformLocation(made, name);
        }
        return this.programs[name] = {made, places};
    }

    /** Sets all that a picture of some size depends on. */
    set({made, places}, view, width, height) {
        const gl = this.gl, model = this.model;
        gl.useProgram(made);
        Object.entries(this.textures).forEach(([name, texture], unit) => {
            gl.activeTexture(gl.TEXTURE0 + unit);
            gl.bindTexture(gl.TEXTURE_2D, texture);
            gl.uniform1i(places[name] ?? null, unit);
        });
        const {origin, direction, normalToCamera, cut, cutNormal} = view.inGrid(model, width / height);
        gl.uniform1ui(places.nodeCount ?? null, model.nodes);
        gl.uniform1i(places.depth ?? null, model.depth);
        const flags = {
            hasNormals: model.sections.NORM, hasCorners: model.corners, hasLeaves: model.leaves, isCells: model.cells,
            hasColors: (model.sections.COLR || model.labels) && view.colors,
            isFlat: model.head.quantity && model.sections.COLR && view.colors,
        };
        for (const [name, is] of Object.entries(flags)) gl.uniform1i(places[name] ?? null, is ? 1 : 0);
        gl.uniform1uiv(places.eyes ?? null, view.eyes());
        gl.uniform3fv(places.origin ?? null, origin.flat());
        gl.uniform3fv(places.direction ?? null, direction.flat());
        gl.uniformMatrix3fv(places.normalToCamera ?? null, false, normalToCamera.flat());
        gl.uniform4fv(places.cut ?? null, cut);
        gl.uniform3fv(places.cutNormal ?? null, cutNormal);
        gl.uniform2f(places.size ?? null, width, height);
        gl.uniform3fv(places.surfaceColor ?? null, [0.80, 0.76, 0.68]);
        gl.uniform4fv(places.background ?? null, view.background.flat());
        gl.uniform1i(places.isSmooth ?? null, 0);
        gl.uniform2f(places.corner ?? null, 0, 0);
        gl.uniform2f(places.jitter ?? null, 0, 0);
        gl.uniform1f(places.weight ?? null, 1);
        gl.bindVertexArray(this.vertices);
        gl.disable(gl.BLEND);
        gl.disable(gl.DEPTH_TEST);
    }

    /** A texture to draw into, of this size and form. */
    into(form, width, height) {
        const gl = this.gl;
        if (!this.target || this.target.form !== form || this.target.width !== width || this.target.height !== height) {
            if (this.target) gl.deleteTexture(this.target.texture);
            const texture = gl.createTexture();
            gl.activeTexture(gl.TEXTURE15);
            gl.bindTexture(gl.TEXTURE_2D, texture);
            gl.texStorage2D(gl.TEXTURE_2D, 1, form, width, height);
            this.target = {texture, form, width, height};
        }
        gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
        gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.target.texture, 0);
        gl.viewport(0, 0, width, height);
    }

    /** One ray a pixel of a picture that is smaller than the canvas by `scale`, and shown on it. */
    quick(view, scale) {
        const gl = this.gl, [w, h] = [gl.canvas.width, gl.canvas.height];
        const [width, height] = [w, h].map(side => Math.max(1, Math.round(side / scale)));
        this.into(gl.RGBA8, width, height);
        this.set(this.program(false), view, width, height);
        gl.drawArrays(gl.TRIANGLES, 0, 3);
        this.show(gl.LINEAR);
    }

    /** Puts what was drawn onto the canvas. */
    show(filter) {
        const gl = this.gl, {width, height} = this.target;
        gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.framebuffer);
        gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
        gl.blitFramebuffer(0, 0, width, height, 0, 0, gl.canvas.width, gl.canvas.height, gl.COLOR_BUFFER_BIT, filter);
        gl.bindFramebuffer(gl.FRAMEBUFFER, null);
        // Waits, so that what was asked for is what was measured.
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    }

    /**
     * A picture with several rays a pixel, in tiles: a generator that gives way after each draw, since one call that takes
     * seconds loses the context on some machines.
     */
    *fine(view, samples) {
        const gl = this.gl, [width, height] = [gl.canvas.width, gl.canvas.height];
        const program = this.program(false), tile = 256;
        // Rooks' places: no two in a row or column.
        const places = [4, 1, 6, 3, 0, 7, 2, 5].map((p, i) => [(i + .5) / 8 - .5, (p + .5) / 8 - .5]);
        for (let y = 0; y < height; y += tile) {
            for (let x = 0; x < width; x += tile) {
                const [w, h] = [Math.min(tile, width - x), Math.min(tile, height - y)];
                this.into(this.sum, tile, tile);
                this.set(program, view, width, height);
                gl.clearColor(0, 0, 0, 0);
                gl.clear(gl.COLOR_BUFFER_BIT);
                gl.uniform1i(program.places.isSmooth ?? null, 1);
                gl.uniform2f(program.places.corner ?? null, x, y);
                gl.uniform1f(program.places.weight ?? null, 1 / samples);
                gl.enable(gl.BLEND);
                gl.blendFunc(gl.ONE, gl.ONE);
                for (let i = 0; i < samples; i++) {
                    gl.uniform2f(program.places.jitter ?? null, ...(samples > 1 ? places[i] : [0, 0]));
                    gl.drawArrays(gl.TRIANGLES, 0, 3);
                    yield;
                }
                gl.disable(gl.BLEND);
                this.copyTile(x, y, w, h);
            }
        }
    }

    /** Puts a tile onto the canvas; a sum of halves cannot be copied as bytes, so it is drawn. */
    copyTile(x, y, w, h) {
        const gl = this.gl;
        if (!this.copy) {
            const text = 'precision highp float;uniform sampler2D a;uniform vec2 at;layout(location=0) out vec4 c;'
                + 'void main(){c=texelFetch(a,ivec2(gl_FragCoord.xy-at),0);}';
            const saved = [this.shaders, this.programs];
            [this.shaders, this.programs] = [text, {}];
            this.copy = this.program(false);
            [this.shaders, this.programs] = saved;
        }
        gl.bindFramebuffer(gl.FRAMEBUFFER, null);
        gl.viewport(0, 0, gl.canvas.width, gl.canvas.height);
        gl.enable(gl.SCISSOR_TEST);
        gl.scissor(x, y, w, h);
        gl.useProgram(this.copy.made);
        gl.activeTexture(gl.TEXTURE14);
        gl.bindTexture(gl.TEXTURE_2D, this.target.texture);
        gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
        gl.uniform1i(this.copy.places.a, 14);
        gl.uniform2f(this.copy.places.at, x, y);
        gl.drawArrays(gl.TRIANGLES, 0, 3);
        gl.disable(gl.SCISSOR_TEST);
    }

    /** Numbers of a picture: of each pixel from the top left one the box plus one, bits of t, level, label and normal.z (8, 8 and 16 bits), and normal.xy. */
    numbers(view, width, height) {
        const gl = this.gl;
        this.into(gl.RGBA32UI, width, height);
        this.set(this.program(true), view, width, height);
        gl.drawArrays(gl.TRIANGLES, 0, 3);
        const found = new Uint32Array(4 * width * height), turned = new Uint32Array(found.length);
        gl.readPixels(0, 0, width, height, gl.RGBA_INTEGER, gl.UNSIGNED_INT, found);
        for (let y = 0; y < height; y++) turned.set(found.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
        gl.bindFramebuffer(gl.FRAMEBUFFER, null);
        return turned;
    }
}
