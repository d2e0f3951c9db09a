//! The parts that sentences are made of; each sentence is defined with its variant.
//!
//! | file | parts |
//! |---|---|
//! | `color` | colours |
//! | `encoding` | byte order marks of text files |
//! | `sanitize` | text from outside, in the one way in which it is printed |
//! | `names` | names of options and jobs, as the caller knows them |
//! | `nearest` | the name that a mistyped word was meant to be |
//! | `number` | numbers with their significant digits |
//! | `system` | cures for refusals of the operating system |

mod color;
mod encoding;
pub(crate) mod names;
mod nearest;
mod number;
mod sanitize;
mod system;

use std::str::FromStr;

use serde::{Deserialize, Deserializer, de::Error};

pub use color::color;
pub(crate) use encoding::{mark_bytes, plain_head};
pub use names::{Name, spell};
pub use nearest::nearest;
pub use number::Count;
pub(crate) use number::{Rounded, Short, WithError, mark, size_title};
pub(crate) use sanitize::html;
pub use sanitize::{Shown, call, data, json, plain, shown};
pub(crate) use system::{reading, writing};

/// An optional value that is given as text.
pub(crate) fn some_text<'de, D: Deserializer<'de>, T: FromStr<Err = String>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    let text = Option::<String>::deserialize(deserializer)?;
    text.map(|text| text.parse()).transpose().map_err(D::Error::custom)
}
