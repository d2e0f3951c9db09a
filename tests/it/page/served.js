'use strict';
// Damaged files of the page's server: what its scripts make of them, up to the picture.
/* global page, models, Drawing, View, SHADER */

/** Opens the models of so many numbers; how many were refused and opened, and what is strange. */
async function served(count, first) {
    const result = {refused: 0, opened: 0, longest: 0, sentences: {}, strange: []}, {gl} = page.drawing;
    for (let number = first; number < first + count; number++) {
        const began = performance.now();
        try {
            for await (const model of models({model: `bad-${number}.oct`})) {
                const drawing = new Drawing(gl, model, SHADER), view = new View(model);
                drawing.programs = page.drawing.programs;
                view.look([number % 9 - 4, number % 7 - 3, number % 5 - 2.5], [0, 0, 1]);
                drawing.numbers(view, 48, 48);
                for (let i = 0; i < 5; i++) view.pick(model, (number * 7 + i * 31) % 100 / 50 - 1, (number * 3 + i * 17) % 100 / 50 - 1, 1);
                drawing.drop();
            }
            result.opened++;
        } catch (error) {
            result.refused++;
            const sentence = error.name === 'Error' ? error.message.replace(/\d+/g, 'N') : error.name;
            result.sentences[sentence] = (result.sentences[sentence] ?? 0) + 1;
            // Of a table that is forged.
            const isForged = number % 5 === 0 && error.name === 'TypeError';
            if (!isForged && !['Error', 'RangeError'].includes(error.name)) result.strange.push(`${number}: ${error.stack}`);
        }
        if (gl.isContextLost()) result.strange.push(`${number}: the graphics are lost`);
        result.longest = Math.max(result.longest, performance.now() - began);
    }
    return result;
}
