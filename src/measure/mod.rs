//! Measurements on finished models, and the models that carry them as values.

mod values;

pub(crate) use values::write_values;
