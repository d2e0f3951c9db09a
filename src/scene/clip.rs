//! Cuts: planes beyond which a body is removed.

use crate::geom::dot;

/// A convex part of the world: points with `normal . p <= limit` for every plane.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clip {
    planes: Vec<CutPlane>,
}

/// A cutting plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutPlane {
    /// Unit vector towards the removed side.
    pub normal: [f64; 3],
    /// Distance of the plane from the world's origin along the normal, in mm.
    pub limit: f64,
    /// Linear RGB of the cut face; `None` leaves it open.
    pub cap: Option<[f64; 3]>,
}

/// Part of a line within the remaining space: t of its entry and exit, and the plane that it enters by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Span {
    pub(super) enter: f64,
    pub(super) leave: f64,
    pub(super) by: Option<usize>,
}

impl Span {
    /// A part of a line without cuts.
    pub(super) const fn of([enter, leave]: [f64; 2]) -> Self {
        Self { enter, leave, by: None }
    }
}

impl Clip {
    /// The part within all of these planes.
    pub fn new(planes: Vec<CutPlane>) -> Self {
        Self { planes }
    }

    /// True if nothing is cut away.
    pub(crate) fn is_empty(&self) -> bool {
        self.planes.is_empty()
    }

    /// The planes.
    pub(crate) fn planes(&self) -> &[CutPlane] {
        &self.planes
    }

    /// The part within both.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        Self { planes: self.planes.iter().chain(&other.planes).copied().collect() }
    }

    /// The part of a line from `limits[0]` to `limits[1]` within the remaining space; `None` if it is empty. A line
    /// that starts on plane `on` and runs out of that space is outside, however its start was rounded.
    pub(super) fn span(
        &self,
        (origin, direction): ([f64; 3], [f64; 3]),
        limits: [f64; 2],
        on: Option<usize>,
    ) -> Option<Span> {
        let mut span = Span::of(limits);
        for (number, plane) in self.planes.iter().enumerate() {
            let (speed, ahead) = (dot(plane.normal, direction), plane.limit - dot(plane.normal, origin));
            if on == Some(number) {
                if speed >= 0.0 {
                    return None;
                }
                continue;
            }
            if speed > 0.0 {
                span.leave = span.leave.min(ahead / speed);
            } else if speed < 0.0 && ahead / speed > span.enter {
                (span.enter, span.by) = (ahead / speed, Some(number));
            } else if speed == 0.0 && ahead < 0.0 {
                return None;
            }
        }
        (span.enter <= span.leave).then_some(span)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_cut_to_what_is_left() {
        let plane = |normal, limit| CutPlane { normal, limit, cap: None };
        let clip = Clip::new(vec![plane([1.0, 0.0, 0.0], 5.0), plane([-1.0, 0.0, 0.0], 2.0)]);
        let x = [1.0, 0.0, 0.0];
        let all = [0.0, f64::INFINITY];
        let span = clip.span(([-10.0, 0.0, 0.0], x), all, None).unwrap();
        assert_eq!(span, Span { enter: 8.0, leave: 15.0, by: Some(1) });
        assert_eq!(clip.span(([0.0; 3], x), all, None).unwrap(), Span { enter: 0.0, leave: 5.0, by: None });
        assert!(clip.span(([6.0, 0.0, 0.0], x), all, None).is_none());
        assert!(clip.span(([6.0, 0.0, 0.0], [0.0, 1.0, 0.0]), all, None).is_none());
        // A start on a plane counts as inside or outside by the line's direction.
        assert!(clip.span(([5.0, 0.0, 0.0], x), all, Some(0)).is_none());
        let back = clip.span(([5.000_000_1, 0.0, 0.0], [-1.0, 0.0, 0.0]), all, Some(0)).unwrap();
        assert!(back.enter == 0.0 && (back.leave - 7.0).abs() < 1e-6 && back.by.is_none());
        assert!(Clip::default().is_empty() && clip.and(&clip).planes().len() == 4);
    }
}
