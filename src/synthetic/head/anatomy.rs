//! Recipes of the synthetic head, in millimetres: x to the patient's left, y to the back, z up, the
//! origin in the middle of the cube. Drawn from general proportions of an adult head; not a scan.

use super::shape::Join::{Add, Cut};
use super::shape::Solid::{Capsule, Ellipsoid};
use super::shape::Step;

/// Everything within the skin.
pub(super) const SOFT_TISSUE: &[Step] = &[
    // Vault, midface, jaw, chin, neck.
    (Add(1.0), Ellipsoid([0.0, 14.0, 33.0], [75.0, 93.0, 76.0])),
    (Add(18.0), Ellipsoid([0.0, 30.0, -100.0], [52.0, 54.0, 90.0])),
    (Add(14.0), Ellipsoid([0.0, -26.0, -22.0], [60.0, 58.0, 62.0])),
    (Add(14.0), Ellipsoid([0.0, -38.0, -60.0], [48.0, 43.0, 42.0])),
    (Add(12.0), Ellipsoid([44.0, -10.0, -46.0], [12.0, 22.0, 34.0])),
    (Add(12.0), Ellipsoid([52.0, -14.0, -18.0], [15.0, 36.0, 14.0])),
    (Add(11.0), Capsule([16.0, -64.0, -86.0], [42.0, -18.0, -76.0], [15.0, 14.0])),
    (Add(10.0), Ellipsoid([0.0, -70.0, -88.0], [19.0, 17.0, 13.0])),
    (Add(12.0), Ellipsoid([42.0, -54.0, -26.0], [18.0, 20.0, 19.0])),
    (Add(10.0), Ellipsoid([38.0, -58.0, 4.0], [14.0, 14.0, 15.0])),
    // Eyes: brow, hollow, ball with lids.
    (Add(9.0), Ellipsoid([24.0, -71.0, 14.0], [21.0, 9.5, 6.0])),
    (Cut(9.0), Ellipsoid([31.0, -92.0, -5.0], [18.0, 17.0, 12.0])),
    (Add(2.5), Ellipsoid([31.0, -67.0, -5.0], [13.0, 13.0, 11.0])),
    (Cut(1.0), Ellipsoid([31.0, -83.0, -6.0], [12.0, 5.0, 0.9])),
    // Nose: bridge, tip, wings, nostrils.
    (Add(7.0), Capsule([0.0, -80.0, 8.0], [0.0, -96.0, -25.0], [6.0, 8.0])),
    (Add(4.0), Ellipsoid([0.0, -99.0, -28.0], [9.0, 8.0, 8.0])),
    (Add(4.0), Ellipsoid([10.5, -92.0, -31.0], [7.0, 10.0, 6.5])),
    (Cut(1.5), Ellipsoid([6.0, -97.0, -37.0], [3.0, 6.0, 5.0])),
    // Mouth: lips and the line between them.
    (Add(4.0), Ellipsoid([0.0, -83.0, -53.0], [22.0, 8.5, 5.0])),
    (Add(4.0), Ellipsoid([0.0, -82.0, -61.5], [19.0, 9.0, 5.5])),
    (Cut(1.5), Ellipsoid([0.0, -95.0, -57.0], [24.0, 9.0, 1.2])),
    // Ears: rim, bowl, lobe.
    (Add(3.0), Ellipsoid([76.0, 20.0, -4.0], [7.0, 17.0, 27.0])),
    (Cut(4.0), Ellipsoid([84.0, 14.0, -1.0], [8.0, 11.0, 18.0])),
    (Add(4.0), Ellipsoid([73.0, 11.0, -28.0], [5.5, 8.0, 11.0])),
];

/// Air inside the head: nose, throat, sinuses.
pub(super) const AIRWAYS: &[Step] = &[
    (Add(1.0), Ellipsoid([7.0, -58.0, -28.0], [5.0, 28.0, 13.0])),
    (Add(4.0), Capsule([0.0, -30.0, -34.0], [0.0, -6.0, -120.0], [8.0, 7.0])),
    (Add(1.0), Ellipsoid([22.0, -49.0, -33.0], [7.5, 11.0, 10.0])),
    (Add(1.0), Ellipsoid([8.0, -28.0, -14.0], [6.0, 9.0, 6.0])),
];

/// Skull, jaw and neck.
pub(super) const BONE: &[Step] = &[
    // Vault as a solid (hollowed last), temples cut in behind the eyes.
    (Add(1.0), Ellipsoid([0.0, 14.0, 35.0], [69.0, 86.0, 68.0])),
    (Add(12.0), Ellipsoid([0.0, -44.0, -8.0], [46.0, 32.0, 24.0])),
    (Cut(8.0), Ellipsoid([74.0, -36.0, 0.0], [20.0, 24.0, 28.0])),
    (Add(8.0), Ellipsoid([48.0, 26.0, -30.0], [9.0, 11.0, 17.0])),
    (Add(8.0), Ellipsoid([36.0, -36.0, -8.0], [12.0, 14.0, 18.0])),
    // Face: brow ridges, cheekbones and their arches, upper jaw, bridge of the nose.
    (Add(7.0), Ellipsoid([26.0, -65.0, 15.0], [19.0, 11.0, 6.5])),
    (Add(7.0), Ellipsoid([46.0, -56.0, -21.0], [12.0, 11.0, 10.0])),
    (Add(5.0), Capsule([46.0, -53.0, 11.0], [47.5, -55.0, -18.0], [4.5, 5.5])),
    (Add(4.0), Capsule([50.0, -48.0, -21.0], [60.0, -18.0, -19.0], [5.5, 3.8])),
    (Add(4.0), Capsule([60.0, -18.0, -19.0], [55.0, 12.0, -15.0], [3.8, 5.0])),
    (Add(9.0), Ellipsoid([0.0, -55.0, -36.0], [31.0, 23.0, 21.0])),
    (Add(5.0), Capsule([0.0, -72.0, 8.0], [0.0, -85.0, -12.0], [7.0, 4.5])),
    // Sockets narrow towards the back; the nose opens as a pear with a septum.
    (Cut(4.0), Ellipsoid([29.0, -76.0, -3.0], [18.0, 24.0, 15.5])),
    (Cut(4.0), Ellipsoid([24.0, -54.0, -4.0], [9.0, 11.0, 8.0])),
    (Cut(3.0), Ellipsoid([6.0, -80.0, -31.0], [7.5, 22.0, 11.0])),
    (Cut(3.0), Ellipsoid([0.0, -82.0, -20.0], [5.5, 16.0, 12.0])),
    (Add(0.5), Ellipsoid([0.0, -60.0, -30.0], [1.1, 18.0, 13.0])),
    // Lower jaw: chin, body, branch with its two processes, the ridge that carries the teeth.
    (Add(5.0), Capsule([0.0, -73.0, -91.0], [18.0, -68.0, -90.0], [8.0, 8.0])),
    (Add(5.0), Capsule([18.0, -68.0, -90.0], [44.0, -18.0, -78.0], [8.0, 7.5])),
    (Add(5.0), Capsule([44.5, -15.0, -76.0], [48.0, -5.0, -40.0], [8.0, 6.0])),
    (Add(4.0), Capsule([48.0, -5.0, -40.0], [51.0, 6.0, -19.0], [6.0, 5.0])),
    (Add(4.0), Capsule([46.0, -14.0, -56.0], [48.0, -23.0, -28.0], [6.5, 3.0])),
    (Add(4.0), Ellipsoid([0.0, -79.0, -95.0], [12.0, 5.0, 6.0])),
    (Add(4.0), Capsule([0.0, -73.0, -80.0], [17.0, -67.0, -80.0], [5.0, 5.0])),
    (Add(4.0), Capsule([17.0, -67.0, -80.0], [34.0, -34.0, -76.0], [5.0, 5.5])),
    // Neck bones with the canal.
    (Add(3.0), Ellipsoid([0.0, 24.0, -52.0], [30.0, 18.0, 7.0])),
    (Add(1.5), Ellipsoid([0.0, 22.0, -70.0], [18.0, 14.0, 9.0])),
    (Add(1.5), Ellipsoid([0.0, 22.0, -90.0], [18.0, 14.0, 9.0])),
    (Add(1.5), Ellipsoid([0.0, 22.0, -110.0], [18.0, 14.0, 9.0])),
    (Add(3.0), Ellipsoid([14.0, 40.0, -72.0], [7.0, 12.0, 6.0])),
    (Add(3.0), Ellipsoid([14.0, 40.0, -92.0], [7.0, 12.0, 6.0])),
    (Add(3.0), Ellipsoid([14.0, 40.0, -112.0], [7.0, 12.0, 6.0])),
    (Add(4.0), Capsule([0.0, 52.0, -70.0], [0.0, 70.0, -78.0], [5.0, 4.0])),
    (Add(4.0), Capsule([0.0, 52.0, -90.0], [0.0, 72.0, -98.0], [5.0, 4.0])),
    (Cut(2.0), Capsule([0.0, 42.0, -20.0], [0.0, 42.0, -120.0], [12.0, 8.0])),
    // The space of the brain.
    (Cut(2.0), Ellipsoid([0.0, 15.0, 36.5], [62.0, 79.0, 61.0])),
];

/// The space within the skull that holds brain and fluid.
pub(super) const CRANIAL_CAVITY: &[Step] = &[
    (Add(1.0), Ellipsoid([0.0, 15.0, 36.5], [62.0, 79.0, 61.0])),
    (Add(4.0), Capsule([0.0, 42.0, -20.0], [0.0, 42.0, -120.0], [10.0, 7.0])),
];

/// Brain before its folds are cut, with the gap between the halves and the ventricles.
pub(super) const BRAIN: &[Step] = &[
    (Add(1.0), Ellipsoid([0.0, 15.0, 37.0], [59.0, 76.0, 57.5])),
    (Cut(3.0), Ellipsoid([0.0, 15.0, 74.0], [1.6, 84.0, 50.0])),
    (Cut(2.0), Ellipsoid([11.0, 6.0, 40.0], [5.0, 24.0, 9.0])),
    (Cut(2.0), Ellipsoid([18.0, 34.0, 30.0], [5.0, 12.0, 10.0])),
    (Add(3.0), Capsule([0.0, 36.0, -4.0], [0.0, 42.0, -120.0], [9.0, 5.0])),
];

/// The part of the brain that folds do not reach.
pub(super) const BRAIN_CORE: &[Step] = &[
    (Add(3.0), Capsule([0.0, 36.0, -4.0], [0.0, 42.0, -120.0], [10.0, 6.0])),
    (Add(1.0), Ellipsoid([0.0, 15.0, 35.0], [44.0, 60.0, 42.0])),
];

/// Two rows of teeth: each represents its mirror image too.
pub(super) const TEETH: &[Step] = &[
    (Add(0.6), Ellipsoid([4.4, -76.5, -60.0], [4.1, 3.2, 7.5])),
    (Add(0.6), Ellipsoid([12.2, -74.2, -59.5], [3.5, 3.2, 7.0])),
    (Add(0.6), Ellipsoid([18.8, -69.8, -59.5], [3.7, 3.9, 7.5])),
    (Add(0.6), Ellipsoid([23.6, -63.4, -58.5], [3.8, 3.8, 6.5])),
    (Add(0.6), Ellipsoid([26.9, -56.0, -58.0], [4.2, 3.8, 6.0])),
    (Add(0.6), Ellipsoid([29.3, -47.2, -57.5], [4.8, 5.0, 5.5])),
    (Add(0.6), Ellipsoid([30.8, -37.4, -57.0], [4.8, 5.0, 5.5])),
    (Add(0.6), Ellipsoid([2.9, -73.8, -74.0], [2.8, 3.0, 7.0])),
    (Add(0.6), Ellipsoid([8.8, -72.6, -74.0], [3.1, 3.0, 7.0])),
    (Add(0.6), Ellipsoid([15.0, -69.3, -74.0], [3.5, 3.6, 7.5])),
    (Add(0.6), Ellipsoid([20.2, -63.2, -73.5], [3.7, 3.8, 6.5])),
    (Add(0.6), Ellipsoid([24.1, -56.2, -72.5], [3.9, 3.9, 6.0])),
    (Add(0.6), Ellipsoid([27.4, -47.6, -71.5], [4.7, 5.1, 5.5])),
    (Add(0.6), Ellipsoid([30.2, -37.6, -70.5], [4.7, 5.1, 5.5])),
];
