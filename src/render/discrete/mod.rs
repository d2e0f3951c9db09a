//! The paper's own traversal (section 3), with its terms: a discrete, 6-connected ray.
//!
//! A ray is represented by three points per box: on the planes of its *floor*, *middle* and *ceiling*, which lie across
//! the ray's *main axis*. Their coordinates along the two other axes name a quadrant each; the quadrants of floor and
//! middle make the path through the lower *storey* of the box, those of middle and ceiling the path through the upper
//! one. Path byte AND infobyte are the children to visit, front to back. A box only costs sums, shifts and comparisons
//! of integers.
//!
//! | file | what it owns |
//! |---|---|
//! | [`line`](mod@line) | main axis, and the three points of a box |
//! | [`path`] | path byte and order of visits |
//! | [`walk`] | the first hit |
//! | [`frame`] | rays of a parallel projection by increments |
//!
//! The exact mode ([`crate::render::single`]) is what pictures use. This one visits every voxel that the line
//! intersects and some that it only passes by, so a silhouette may gain a voxel; how many pixels differ is reported by
//! `oct report`.
//!
//! Errors and gaps of the paper (E1 to E7 in the notes to this project), and the choice here:
//!
//! | | the paper | here |
//! |---|---|---|
//! | E1 | main axis by the greatest component | by the greatest absolute value; of equal ones the first of x, y, z |
//! | E2 | the middle point always lies in the box | it need not; quadrants are numbers -1, 0, 1, 2, of which 0 and 1 are in the box |
//! | E3 | one bit per coordinate addresses a table of 14 bits | no table, which gained nothing: the path byte leaves out what lies outside of the box, so no child is visited that the path does not touch |
//! | E4 | the worked example is printed with a digit missing, and visits are "left to right" | axes are mirrored so that the ray runs upwards; then front to back is the lowest bit first |
//! | E5 | of two boxes that widening adds, lower levels choose | at the last level nothing is left to choose by: both count as visited, the first in Morton order of the walk's frame first |
//! | E6 | skins of 26 or of 6 connections | either: the widened ray is 6-connected, so it finds no tunnel in a 26-connected skin |
//! | E7 | points by increments | only in parallel projection; in perspective each ray is set up for itself. A ray that starts in the grid begins with its own coordinates, not with those of its storey's floor |

pub mod frame;
pub mod line;
pub mod path;
pub mod walk;

pub(crate) use frame::DiscreteRays;
pub use line::{Line, MainAxis};
pub use walk::first_hit;
