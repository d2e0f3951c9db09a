//! Measurements on finished models, and the models that carry them as values.
//!
//! | part | what it holds |
//! |---|---|
//! | [`nearest`] | nearest point of a surface, signed distance, normal and cell |
//! | [`values`] | a writer of models with values |

#[allow(dead_code, reason = "its callers come next")]
pub(crate) mod nearest;
mod values;

pub(crate) use values::write_values;
