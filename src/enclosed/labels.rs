//! What lies within the skins of labels.
//!
//! A voxel that is not skin has the label of all its neighbours. So a component of such voxels is either background
//! or the inside of one label throughout: background if it reaches the border or lies between skins of several labels,
//! and either where the skin of one label surrounds it. The table says how many voxels each label has.

use super::Side;
use super::sweep::Fates;

/// The labels of the skin voxels next to a component.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Border {
    /// None so far, or labels are not looked at.
    #[default]
    Unlabelled,
    One(u16),
    Several,
}

impl Border {
    /// That of a skin voxel; 0 where labels are not looked at.
    pub(super) fn of(label: u16) -> Self {
        if label == 0 { Self::Unlabelled } else { Self::One(label) }
    }

    pub(super) fn with(self, other: Self) -> Self {
        match (self, other) {
            (Self::Unlabelled, border) | (border, Self::Unlabelled) => border,
            (a, b) if a == b => a,
            _ => Self::Several,
        }
    }
}

/// A component that the skin of one label surrounds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hollow {
    pub(super) name: u32,
    pub(super) label: u16,
    pub(super) voxels: u64,
    /// 1 where all normals around it say that it is inside, -1 where all say that it is a cavity.
    pub(super) inward: f64,
}

/// Settles where the components lie that one label surrounds. Gives the voxels of those that remain uncertain: the
/// likelier ones by their normals do not have as many voxels as the label has.
pub(super) fn settle_labels(
    mut hollows: Vec<Hollow>,
    beyond_skin: &dyn Fn(u16) -> u64,
    fates: &mut Fates,
) -> u64 {
    hollows.sort_by(|a, b| {
        let by_normals = a.label.cmp(&b.label).then(b.inward.total_cmp(&a.inward));
        by_normals.then(b.voxels.cmp(&a.voxels)).then(a.name.cmp(&b.name))
    });
    let mut unknown = 0;
    for of_label in hollows.chunk_by(|a, b| a.label == b.label) {
        let wanted = beyond_skin(of_label[0].label);
        let sum = |some: &[Hollow]| some.iter().map(|hollow| hollow.voxels).sum::<u64>();
        // The likelier ones, all without normals; or else the likeliest, and of those the largest, that have just so many
        // voxels.
        let likelier = of_label.iter().take_while(|hollow| hollow.inward >= 0.0).count();
        let fits = |count: &usize| sum(&of_label[..*count]) == wanted;
        let fitting = std::iter::once(likelier).find(fits).or_else(|| {
            let mut so_far = 0;
            let ends = of_label.iter().map(|hollow| {
                so_far += hollow.voxels;
                so_far
            });
            let mut ends = std::iter::once(0).chain(ends);
            ends.position(|end| end == wanted)
        });
        if fitting.is_none() {
            unknown += sum(of_label);
        }
        let inside = fitting.unwrap_or(likelier);
        for (at, hollow) in of_label.iter().enumerate() {
            fates.settle(hollow.name, if at < inside { Side::Inside } else { Side::Outside });
        }
    }
    unknown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_normals_the_largest_that_fit_are_inside_or_all() {
        let hollows = |sizes: &[u64]| {
            (0..)
                .zip(sizes)
                .map(|(name, voxels)| Hollow { name, label: 1, voxels: *voxels, inward: 0.0 })
                .collect::<Vec<_>>()
        };
        for (sizes, wanted, unknown, inside) in [
            (&[30, 1000][..], 1000, 0, &[1][..]),
            (&[30, 1000, 7], 1030, 0, &[0, 1]),
            (&[30, 1000], 900, 1030, &[0, 1]),
            (&[30, 1000], 0, 0, &[]),
        ] {
            let mut fates = Fates::of(sizes.len());
            assert_eq!(settle_labels(hollows(sizes), &|_| wanted, &mut fates), unknown, "{sizes:?} {wanted}");
            let found: Vec<usize> =
                (0..sizes.len()).filter(|i| fates.side_of(*i) == Some(Side::Inside)).collect();
            assert_eq!(found, inside, "{sizes:?} {wanted}");
        }
    }
}
