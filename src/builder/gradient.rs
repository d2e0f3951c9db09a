//! Normals from a 5x5x5 neighbourhood, at skin voxels only (the paper, section 4: the modified
//! gradient method; the taps are chosen by measurement, see `estimator` and `tests/it/normals.rs`).
//!
//! Kernels are separable: along the differentiated axis the taps of the derivative, along the other two the taps of the
//! smoothing. All sums are IEEE single in one fixed order, so results do not depend on the machine, the instruction set
//! or the grouping of voxels: a window of 16 samples gives 12 neighbouring voxels at once, a window of 8 gives 4, each
//! lane with the same operations.

use super::estimator::{Estimate, Gradient, Taps};
use super::lanes::{RingSample, rows_of, shifted, zero};
use super::skin::Exposed;
use crate::cpu::{Kernel, Lanes, OCTET, Octet, Term, dispatch};
use crate::format::normal;
use bytemuck::Zeroable as _;

pub(super) const REACH: u32 = 2;
/// Samples of a wide and of a narrow window.
const WIDE: usize = 2 * OCTET;
const NARROW: usize = OCTET;
/// Samples that a window may read beyond the last one it needs.
pub(super) const OVERREAD: usize = WIDE;
/// Most voxels of one brick in one slice.
pub(super) const SLICE_VOXELS: usize = 32 * 32;

/// One number for each axis and skin voxel, in the order of the voxels (y, then x).
type Axes = [[f32; SLICE_VOXELS]; 3];

/// Gradients of one brick in one slice.
pub(super) struct Gradients {
    axes: Axes,
    /// Gradients of the two small estimators that [`Gradient::Auto`] compares with.
    small: Option<Box<[Axes; 2]>>,
}

impl Gradients {
    pub(super) fn new(rule: &NormalRule) -> Box<Self> {
        let axes = [[0.0; SLICE_VOXELS]; 3];
        Box::new(Self { axes, small: rule.small.map(|_| Box::new([axes; 2])) })
    }
}

/// The input of the gradients of one brick in one slice.
pub(super) struct SliceWindow<'a, R> {
    /// Slices z-2 ..= z+2.
    pub(super) planes: [&'a [R]; 5],
    /// Samples from one row to the next.
    pub(super) stride: usize,
    /// Index in a plane of the brick's sample at x = 0, y = 0.
    pub(super) origin: usize,
    /// Mask of the skin voxels of each row.
    pub(super) skin: &'a [u32; 32],
    /// Mask of the skin voxels whose whole neighbourhood lies in the volume.
    pub(super) interior: &'a [u32; 32],
}

/// Computes the gradients of all interior skin voxels; slots of the others are left unchanged.
fn gradients<R: RingSample>(window: &SliceWindow<'_, R>, estimate: &Estimate, out: &mut Axes) {
    dispatch(GradientKernel { window, taps: estimate.taps, out });
}

struct GradientKernel<'a, 'b, R> {
    window: &'a SliceWindow<'b, R>,
    taps: Taps,
    out: &'a mut Axes,
}

impl<R: RingSample> Kernel for GradientKernel<'_, '_, R> {
    type Output = ();

    #[inline(always)]
    fn run(self, lanes: impl Lanes) {
        // The usual taps as constants: the compiler knows them in the loop.
        if self.taps == Taps::ISOTROPIC {
            self.with_taps(Taps::ISOTROPIC, lanes);
        } else {
            let taps = self.taps;
            self.with_taps(taps, lanes);
        }
    }
}

impl<R: RingSample> GradientKernel<'_, '_, R> {
    #[inline(always)]
    fn with_taps(self, taps: Taps, lanes: impl Lanes) {
        let (w, out) = (self.window, self.out);
        let mut base = 0;
        for y in 0..32 {
            let skin = w.skin[y];
            let mut todo = w.interior[y];
            while todo != 0 {
                let first = todo.trailing_zeros();
                let at = w.origin + y * w.stride + first as usize;
                let done = if (todo >> first) >> (NARROW - 4) == 0 {
                    let found = window::<R, _, NARROW>(lanes, w, taps, at);
                    store(out, base, [skin, todo], first, &found, NARROW - 4)
                } else {
                    let found = window::<R, _, WIDE>(lanes, w, taps, at);
                    store(out, base, [skin, todo], first, &found, WIDE - 4)
                };
                todo &= !done;
            }
            base += skin.count_ones() as usize;
        }
    }
}

/// Smoothing over five terms.
#[inline(always)]
fn smooth<T: Term>(taps: [i8; 3], v: [T; 5]) -> T {
    let (near, far) = (v[1] + v[3], v[0] + v[4]);
    v[2].times(taps[0]) + near.times(taps[1]) + far.times(taps[2])
}

/// The derivative over five terms.
#[inline(always)]
fn derive<T: Term>(taps: [i8; 2], v: [T; 5]) -> T {
    let (near, far) = (v[3] - v[1], v[4] - v[0]);
    near.times(taps[0]) + far.times(taps[1])
}

/// Gradients of `N - 4` neighbouring voxels, the first at sample `at`; the last 4 lanes are void.
///
/// Along y and z whole vectors are combined; along x the same vectors are read again, shifted.
#[inline(always)]
fn window<R: RingSample, L: Lanes, const N: usize>(
    lanes: L,
    w: &SliceWindow<'_, R>,
    taps: Taps,
    at: usize,
) -> [[f32; N]; 3] {
    let start = at - 2 * w.stride - 2;
    let Taps { smooth: [taps_x, taps_y, taps_z], derive: taps_d } = taps;
    // Room behind the last lane, for the shifted reads of the void ones.
    let mut sums = [[R::Number::zeroed(); WIDE + OCTET]; 3];
    for block in 0..N / OCTET {
        let mut smoothed = [zero::<R, L>(lanes); 5];
        let mut derived = [zero::<R, L>(lanes); 5];
        for (k, plane) in w.planes.iter().enumerate() {
            let [a, b, c, d, e] = rows_of::<R, OCTET, 5>(plane, start + block * OCTET, w.stride);
            let wide = |row| R::widen(lanes, row);
            let rows = [wide(&a), wide(&b), wide(&c), wide(&d), wide(&e)];
            (smoothed[k], derived[k]) = (smooth(taps_y, rows), derive(taps_d, rows));
        }
        let columns = [smooth(taps_z, smoothed), smooth(taps_z, derived), derive(taps_d, smoothed)];
        for (sums, column) in sums.iter_mut().zip(columns) {
            sums[block * OCTET..][..OCTET].copy_from_slice(&column.store());
        }
    }
    let mut out = [[0.0; N]; 3];
    for block in 0..N / OCTET {
        let shifted = |axis: usize| shifted::<R, L, 5>(lanes, &sums[axis], block * OCTET);
        let found = [derive(taps_d, shifted(0)), smooth(taps_x, shifted(1)), smooth(taps_x, shifted(2))];
        for (out, found) in out.iter_mut().zip(found) {
            out[block * OCTET..][..OCTET].copy_from_slice(&found.to_f32());
        }
    }
    out
}

/// Copies the wanted lanes to their voxels' slots and returns the voxels that are done.
#[inline(always)]
fn store<const N: usize>(
    out: &mut Axes,
    base: usize,
    [skin, todo]: [u32; 2],
    first: u32,
    lanes: &[[f32; N]; 3],
    count: usize,
) -> u32 {
    #[expect(clippy::cast_possible_truncation, reason = "voxels beyond the brick's 32 are another brick's")]
    let done = todo & (((1_u64 << count) - 1) << first) as u32;
    let mut now = done;
    while now != 0 {
        let x = now.trailing_zeros();
        now &= now - 1;
        let slot = base + (skin & ((1_u32 << x) - 1)).count_ones() as usize;
        let lane = (x - first) as usize;
        for (axis, lanes) in out.iter_mut().zip(lanes) {
            axis[slot & (SLICE_VOXELS - 1)] = lanes[lane & (N - 1)];
        }
    }
    done
}

/// Gradient of one voxel from its 125 depths (`[dz][dy][dx]`), for neighbourhoods that leave the
/// volume or hold values that are not finite.
pub(super) fn gradient_of_depths(estimate: &Estimate, depths: &[[[f32; 5]; 5]; 5]) -> [f32; 3] {
    let Taps { smooth: [taps_x, taps_y, taps_z], derive: taps_d } = estimate.taps;
    let mut sums = [[0.0; 5]; 3];
    for x in 0..5 {
        let (mut smoothed, mut derived) = ([0.0; 5], [0.0; 5]);
        for (z, rows) in depths.iter().enumerate() {
            let row = [rows[0][x], rows[1][x], rows[2][x], rows[3][x], rows[4][x]];
            (smoothed[z], derived[z]) = (smooth(taps_y, row), derive(taps_d, row));
        }
        [sums[0][x], sums[1][x], sums[2][x]] =
            [smooth(taps_z, smoothed), smooth(taps_z, derived), derive(taps_d, smoothed)];
    }
    [derive(taps_d, sums[0]), smooth(taps_x, sums[1]), smooth(taps_x, sums[2])]
}

/// Turns gradients into outward normal codes.
pub(super) struct NormalRule {
    usual: Estimate,
    /// For [`Gradient::Auto`]: [`Gradient::Central`] and [`Gradient::Sobel`].
    small: Option<[Estimate; 2]>,
    /// For [`Gradient::Auto`]: [`Gradient::Label5`].
    label: Estimate,
}

/// Ratio, in squared angles, of the turn of normals by 5x5x5 to the turn by 3x3x3 from which the surface counts as
/// bent. A ball has 0.05 to 0.09, also with noise, without grey levels and between thick slices; Marschner and Lobb's
/// signal has 1 to 2.
const BENDS_FROM: f64 = 0.3;

impl NormalRule {
    pub(super) fn new(spacing_mm: [f64; 3], gradient: Gradient) -> Self {
        let estimate = |gradient| Estimate::new(gradient, spacing_mm);
        let small = (gradient == Gradient::Auto).then(|| [Gradient::Central, Gradient::Sobel].map(estimate));
        Self { usual: estimate(gradient), small, label: estimate(Gradient::Label5) }
    }

    /// Bytes of [`Gradients`] beyond what every rule needs.
    pub(super) fn more_bytes(gradient: Gradient) -> u64 {
        if gradient == Gradient::Auto { size_of::<[Axes; 2]>() as u64 } else { 0 }
    }

    /// Computes the gradients of the interior voxels of a brick slice, and returns the estimator that was taken.
    ///
    /// [`Gradient::Auto`] decides for the slice of a brick as a whole, the same 32 x 32 voxels in every build. For two
    /// values only, the surface is known only by where they meet, and the widest weights are best. Else: from two
    /// samples an axis to 3x3x3, and from there to 5x5x5, the gain against noise becomes less, but a surface that bends
    /// is blurred more: so the second turn of the normals is small against the first with noise (or steps, or a smooth
    /// surface), and great where the surface bends.
    pub(super) fn estimate<R: RingSample>(
        &self,
        window: &SliceWindow<'_, R>,
        out: &mut Gradients,
    ) -> Estimate {
        if self.small.is_some() && has_two_values(window) {
            gradients(window, &self.label, &mut out.axes);
            return self.label;
        }
        gradients(window, &self.usual, &mut out.axes);
        let (Some(small), Some(axes)) = (&self.small, out.small.as_deref_mut()) else { return self.usual };
        for (estimate, axes) in small.iter().zip(&mut *axes) {
            gradients(window, estimate, axes);
        }
        let [central, sobel] = small;
        let (mut to_3, mut to_5, mut base) = (0.0_f64, 0.0_f64, 0);
        for (skin, interior) in window.skin.iter().zip(window.interior) {
            let mut bits = *interior;
            while bits != 0 {
                let x = bits.trailing_zeros();
                bits &= bits - 1;
                let slot = (base + (skin & ((1_u32 << x) - 1)).count_ones() as usize) & (SLICE_VOXELS - 1);
                let n = |axes: &Axes, estimate: &Estimate| -> [f64; 3] {
                    std::array::from_fn(|a| f64::from(axes[a][slot] * estimate.per_spacing[a]))
                };
                let middle = n(&axes[1], sobel);
                let turns = [n(&axes[0], central), n(&out.axes, &self.usual)].map(|v| turn(v, middle));
                // Vectors without a direction cannot be compared.
                if let [Some(first), Some(second)] = turns {
                    (to_3, to_5) = (to_3 + first, to_5 + second);
                }
            }
            base += skin.count_ones() as usize;
        }
        if to_5 <= BENDS_FROM * to_3 {
            return self.usual;
        }
        out.axes = axes[0];
        *central
    }

    /// Writes the codes of a brick slice's skin voxels to `codes`, in the order of the gradients.
    ///
    /// Outward is against the gradient of depth. `repair` gives the gradient of the voxel in row y, column x where the
    /// fast kernel could not: not interior, or not finite. A normal against the exposed faces is mirrored to their
    /// side: the voxel is the far side of something thin, or a pit in noise. Where the gradient vanishes, the sum of
    /// the exposed faces' directions replaces it, and if that vanishes as well (a plate one voxel thick), the first
    /// exposed axis: never a zero normal, never one into the model.
    pub(super) fn codes<R>(
        estimate: &Estimate,
        window: &SliceWindow<'_, R>,
        exposed: &[Exposed; 32],
        g: &mut Gradients,
        codes: &mut Codes,
        repair: impl Fn(usize, u32) -> [f32; 3],
    ) {
        let mut at = 0;
        for (y, exposed) in exposed.iter().enumerate() {
            let mut bits = window.skin[y];
            if bits == 0 {
                continue;
            }
            let open = exposed.by_voxel(!window.interior[y]);
            while bits != 0 {
                let x = bits.trailing_zeros();
                let open = open[(x & 31) as usize];
                bits &= bits - 1;
                let slot = at & (SLICE_VOXELS - 1);
                let e = OUTWARD[usize::from(open)];
                let mut n: [f32; 3] = std::array::from_fn(|a| -g.axes[a][slot] * estimate.per_spacing[a]);
                let dot = n[0] * e[0] + n[1] * e[1] + n[2] * e[2];
                // False for a border voxel (its `e` is NaN), a vanishing, inward or infinite gradient.
                if !(dot > 0.0 && dot < f32::INFINITY) {
                    n = unusual(estimate, n, open, || repair(y, x));
                }
                for (axis, n) in g.axes.iter_mut().zip(n) {
                    axis[slot] = n;
                }
                at += 1;
            }
        }
        dispatch(EncodeKernel { g, codes, len: at });
    }
}

/// True if there are at most two values around the interior voxels. With grey levels the loop ends at the first voxel.
fn has_two_values<R: RingSample>(window: &SliceWindow<'_, R>) -> bool {
    let mut values: [Option<R>; 2] = [None; 2];
    for (y, interior) in window.interior.iter().enumerate().filter(|(_, interior)| **interior != 0) {
        let (first, last) = (interior.trailing_zeros() as usize, 31 - interior.leading_zeros() as usize);
        let corner = window.origin + y * window.stride + first - 2 * window.stride - 2;
        for plane in window.planes {
            for row in 0..5 {
                for sample in &plane[corner + row * window.stride..][..last - first + 5] {
                    match values {
                        [Some(a), _] if a == *sample => {}
                        [_, Some(b)] if b == *sample => {}
                        [None, _] => values[0] = Some(*sample),
                        [_, None] => values[1] = Some(*sample),
                        _ => return false,
                    }
                }
            }
        }
    }
    true
}

/// The rare cases of [`NormalRule::codes`]: `n` is the plain outward vector, `open` the mask of the voxel's exposed
/// faces.
#[cold]
fn unusual(estimate: &Estimate, n: [f32; 3], open: u8, repair: impl Fn() -> [f32; 3]) -> [f32; 3] {
    let finite = |v: [f32; 3]| (v[0] + v[1] + v[2]).is_finite();
    let mut n = n;
    if open & BORDER != 0 || !finite(n) {
        let g = repair();
        n = std::array::from_fn(|a| -g[a] * estimate.per_spacing[a]);
    }
    let faces = open & (BORDER - 1);
    let e = OUTWARD[usize::from(faces)];
    let against = n[0] * e[0] + n[1] * e[1] + n[2] * e[2] < 0.0;
    if n != [0.0; 3] {
        let along = (n[0] * e[0] + n[1] * e[1] + n[2] * e[2]) / (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]);
        return if against { std::array::from_fn(|a| n[a] - 2.0 * along * e[a]) } else { n };
    }
    if e != [0.0; 3] {
        return e;
    }
    let axis = (0..3).find(|a| faces >> (2 * a) & 1 == 1).unwrap_or(2);
    std::array::from_fn(|a| if a == axis { 1.0 } else { 0.0 })
}

/// Approximate square of the angle between two vectors: twice one less its cosine; `None` for a vector without
/// direction.
fn turn(a: [f64; 3], b: [f64; 3]) -> Option<f64> {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let lengths = (dot(a, a) * dot(b, b)).sqrt();
    let turn = 2.0 - 2.0 * (dot(a, b) / lengths);
    turn.is_finite().then_some(turn)
}

/// Index bit of voxels outside the interior, above the bits of the six faces.
const BORDER: u8 = 1 << 6;

/// Sum of the directions of the exposed faces, by the six bits of their mask; NaN for border voxels.
const OUTWARD: [[f32; 3]; 128] = {
    let mut table = [[f32::NAN; 3]; 128];
    let mut faces = 0;
    while faces < 64 {
        let mut axis = 0;
        while axis < 3 {
            let (low, high) = (faces >> (2 * axis) & 1, faces >> (2 * axis + 1) & 1);
            table[faces][axis] = high as f32 - low as f32;
            axis += 1;
        }
        faces += 1;
    }
    table
};

/// Eight bits spread to the lowest bits of eight bytes.
const SPREAD_TO_BYTES: [u64; 256] = {
    let mut table = [0; 256];
    let mut bits = 0;
    while bits < 256 {
        let mut i = 0;
        while i < 8 {
            table[bits] |= (bits as u64 >> i & 1) << (8 * i);
            i += 1;
        }
        bits += 1;
    }
    table
};

impl Exposed {
    /// Mask of each voxel: bit f set for exposed face f, and [`BORDER`] where `border` is set.
    #[inline(always)]
    fn by_voxel(&self, border: u32) -> [u8; 32] {
        let mut out = [0; 32];
        for (k, eight) in out.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            let part = |mask: u32| SPREAD_TO_BYTES[(mask >> (8 * k) & 0xff) as usize];
            let mut word = part(border) << 6;
            for (f, mask) in self.faces.iter().enumerate() {
                word |= part(*mask) << f;
            }
            *eight = word.to_le_bytes();
        }
        out
    }
}

/// Normals of a brick slice's skin voxels, as stored.
pub(super) struct Codes {
    code: [u16; SLICE_VOXELS],
}

impl Codes {
    pub(super) fn new() -> Box<Self> {
        Box::new(Self { code: [0; SLICE_VOXELS] })
    }

    /// Items of `NORM` for the first `count` voxels.
    pub(super) fn codes(&self, count: usize) -> &[u8] {
        bytemuck::cast_slice(&self.code[..count])
    }
}

struct EncodeKernel<'a> {
    g: &'a Gradients,
    codes: &'a mut Codes,
    len: usize,
}

impl Kernel for EncodeKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        // Whole groups of 8 vectorise; slots past the end hold old gradients and are not used.
        let len = self.len.next_multiple_of(8).min(SLICE_VOXELS);
        let [x, y, z] = self.g.axes.each_ref().map(|axis| &axis[..len]);
        for (i, code) in self.codes.code[..len].iter_mut().enumerate() {
            *code = normal::encode([x[i], y[i], z[i]]);
        }
    }
}
