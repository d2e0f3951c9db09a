//! The clear bodies around a point of a line, one within another.

/// Most bodies that a line keeps track of; further ones within those are passed as if they were not clear.
const MAX: usize = 4;

/// Clear bodies by number, the innermost last.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Media {
    bodies: [usize; MAX],
    count: usize,
}

impl Media {
    fn known(&self) -> &[usize] {
        self.bodies.get(..self.count).unwrap_or_default()
    }

    /// The body that refracts here; `None` in the open.
    pub(super) fn innermost(&self) -> Option<usize> {
        self.known().last().copied()
    }

    /// True if the line runs within this body.
    pub(super) fn has(&self, body: usize) -> bool {
        self.known().contains(&body)
    }

    /// State after the line has entered a body.
    pub(super) fn entered(mut self, body: usize) -> Self {
        if !self.has(body)
            && let Some(place) = self.bodies.get_mut(self.count)
        {
            *place = body;
            self.count += 1;
        }
        self
    }

    /// State after the line has left a body, which need not be the innermost.
    pub(super) fn left(self, body: usize) -> Self {
        let others = self.known().iter().filter(|known| **known != body);
        others.fold(Self::default(), |rest, other| rest.entered(*other))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_are_left_in_any_order() {
        let within = Media::default().entered(7).entered(3).entered(7);
        assert_eq!((within.innermost(), within.has(7), within.has(4)), (Some(3), true, false));
        assert_eq!(within.left(3).innermost(), Some(7));
        assert_eq!(within.left(7).innermost(), Some(3));
        assert_eq!(within.left(7).left(3).left(3).innermost(), None);
        // One body too many is not tracked, and is left without harm.
        let full = (0..5).fold(Media::default(), Media::entered);
        assert_eq!(
            (full.innermost(), full.left(4).innermost(), full.left(3).innermost()),
            (Some(3), Some(3), Some(2))
        );
    }
}
