//! Values of a scene's text: within their limits, or refused with their key.

use crate::fault::{Fault, bad};
use crate::geom::dot;
use crate::render::shade::linear_of;
use crate::text::{Short, color, shown};

use super::fault::{Key, Table};

/// Limit of lengths and coordinates, in mm.
pub(super) const FAR: f64 = 1e12;
/// Limit of the strength of light.
const STRONG: f64 = 1e6;

/// Checks the values of one table.
pub(super) struct Checked(pub(super) Table);

impl Checked {
    pub(super) fn key(&self, name: &'static str) -> Key {
        Key { table: self.0.clone(), name }
    }

    pub(super) fn number(
        &self,
        name: &'static str,
        value: f64,
        [least, most]: [f64; 2],
    ) -> Result<f64, Fault> {
        if (least..=most).contains(&value) {
            return Ok(value);
        }
        Err(bad!("{}: {value} is out of range; choose {} to {}", self.key(name), Short(least), Short(most)))
    }

    pub(super) fn part(&self, name: &'static str, value: Option<f64>, usual: f64) -> Result<f64, Fault> {
        value.map_or(Ok(usual), |value| self.number(name, value, [0.0, 1.0]))
    }

    pub(super) fn whole(
        &self,
        name: &'static str,
        value: Option<u32>,
        usual: u32,
        limits: [u32; 2],
    ) -> Result<u32, Fault> {
        let Some(value) = value else { return Ok(usual) };
        self.number(name, value.into(), limits.map(f64::from)).map(|_| value)
    }

    pub(super) fn point(&self, name: &'static str, value: [f64; 3]) -> Result<[f64; 3], Fault> {
        value.iter().try_for_each(|v| self.number(name, *v, [-FAR, FAR]).map(|_| ()))?;
        Ok(value)
    }

    /// A unit vector.
    pub(super) fn direction(&self, name: &'static str, value: [f64; 3]) -> Result<[f64; 3], Fault> {
        let value = self.point(name, value)?;
        let length = dot(value, value).sqrt();
        if !length.is_normal() {
            return Err(bad!(
                "{}: {}",
                self.key(name),
                if name == "planes" {
                    "a row of which the first three numbers are 0 is not a direction; write rows such as [0, 0, 1, 40]"
                } else {
                    "has no length, so it is not a direction; write one such as [0, -1, 1]"
                }
            ));
        }
        Ok(value.map(|c| c / length))
    }

    /// Linear RGB of a colour.
    pub(super) fn color(&self, name: &'static str, text: &str) -> Result<[f64; 3], Fault> {
        color(text).map(linear_of).map_err(|wrong| bad!("{}: {wrong}", self.key(name)))
    }

    /// Light from a colour and a strength.
    pub(super) fn light(
        &self,
        color: Option<&str>,
        strength: Option<f64>,
        usual: f64,
    ) -> Result<[f64; 3], Fault> {
        let color = color.map_or(Ok([1.0; 3]), |text| self.color("color", text))?;
        let strength = strength.map_or(Ok(usual), |v| self.number("strength", v, [0.0, STRONG]))?;
        Ok(color.map(|c| c * strength))
    }

    /// The fault of a key without another one.
    pub(super) fn needs(&self, name: &'static str, other: &str) -> Fault {
        bad!("{}: needs {other} as well; add it", self.key(name))
    }

    pub(super) fn not_both(&self, name: &'static str, given: bool, other: &'static str) -> Result<(), Fault> {
        if given {
            return Err(bad!("{}: does not go with {other}; leave one of them out", self.key(name)));
        }
        Ok(())
    }

    pub(super) fn unknown<'n>(
        &self,
        name: &'static str,
        given: &str,
        known: impl IntoIterator<Item = &'n str>,
    ) -> Fault {
        let known: Vec<String> = known.into_iter().map(|name| shown(name).to_string()).collect();
        let choices = match &known[..] {
            [others @ .., last] if !others.is_empty() => format!("{} or {last}", others.join(", ")),
            few => few.concat(),
        };
        bad!("{}: '{}' is unknown; choose {choices}", self.key(name), shown(given))
    }

    pub(super) fn few(&self, name: &'static str, count: usize, most: usize) -> Result<(), Fault> {
        if count > most {
            return Err(bad!("{}: {count} are too many; write at most {most}", self.key(name)));
        }
        Ok(())
    }
}
