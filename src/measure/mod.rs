//! Measurements on finished models, and the models that carry them as values.
//!
//! | part | what it holds |
//! |---|---|
//! | [`nearest`] | nearest point of a surface, signed distance, normal and cell |
//! | [`statistics`] | mean, RMS and percentiles by area |
//! | [`places`] | connected places that stand out |
//! | [`fit`] | the motion that brings one surface closest to another |
//! | [`uncertainty`] | intervals of cells by noise |
//! | [`values`] | a writer of models with values |

pub(crate) mod fit;
pub(crate) mod nearest;
pub(crate) mod places;
pub(crate) mod statistics;
pub(crate) mod uncertainty;
mod values;

pub(crate) use values::write_values;
