//! The parts that sentences are made of; each sentence stands with the variant that it is about.
//!
//! | file | parts |
//! |---|---|
//! | `foreign` | text from outside, in the one way in which it is printed |
//! | `names` | names of options and jobs, as the caller knows them |
//! | `number` | numbers with the digits that mean something |
//! | `system` | cures for refusals of the operating system |

mod foreign;
pub(crate) mod names;
mod number;
mod system;

pub(crate) use foreign::html;
pub use foreign::{Foreign, Shown, call, data, json, plain, shown};
pub use names::{Name, spell};
pub(crate) use number::{Short, WithError};
pub(crate) use system::{reading, writing};
