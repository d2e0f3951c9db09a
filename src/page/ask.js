'use strict';
/* global $, page, canvas, say, redraw, drawMarks, drawScale, drawCube */
// Pictures of a page's server, where the model is not drawn here.

/** Asks `oct` for a picture with one pixel for `scale` of the page's, one at a time. */
function ask(scale) {
    asked = 0;
    clearTimeout(page.moving);
    const next = new Image(), sides = [canvas.clientWidth, canvas.clientHeight].map(side => Math.max(1, Math.round(side / scale)));
    const follow = () => {
        asked = 0;
        page.moving = setTimeout(() => scale > 1 && !asked && ask(1), 120);
    };
    asked = -1;
    next.onload = () => {
        next.id = 'still';
        next.alt = $('still').alt;
        $('still').replaceWith(next);
        drawMarks();
        drawScale();
        drawCube();
        const changed = page.view.toString() !== shown;
        follow();
        if (changed) redraw();
    };
    next.onerror = () => {
        follow();
        say('oct gave no picture; is it still running?', true);
    };
    const shown = page.view.toString();
    next.src = `picture?${shown}&w=${sides[0]}&s=${sides[1]}`;
}
