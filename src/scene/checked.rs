//! Values of a scene's text: within their limits, or refused with their key.

use crate::geom::dot;
use crate::render::shade::linear_of;

use super::fault::{Key, SceneFault, Table};

/// Lengths and places in mm.
pub(super) const FAR: f64 = 1e12;
/// Strength of light.
const STRONG: f64 = 1e6;

/// Looks after the values of one table.
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
    ) -> Result<f64, SceneFault> {
        if (least..=most).contains(&value) {
            return Ok(value);
        }
        Err(SceneFault::Range { key: self.key(name), value, least, most })
    }

    pub(super) fn part(&self, name: &'static str, value: Option<f64>, usual: f64) -> Result<f64, SceneFault> {
        value.map_or(Ok(usual), |value| self.number(name, value, [0.0, 1.0]))
    }

    pub(super) fn whole(
        &self,
        name: &'static str,
        value: Option<u32>,
        usual: u32,
        limits: [u32; 2],
    ) -> Result<u32, SceneFault> {
        let Some(value) = value else { return Ok(usual) };
        self.number(name, value.into(), limits.map(f64::from)).map(|_| value)
    }

    pub(super) fn point(&self, name: &'static str, value: [f64; 3]) -> Result<[f64; 3], SceneFault> {
        value.iter().try_for_each(|v| self.number(name, *v, [-FAR, FAR]).map(|_| ()))?;
        Ok(value)
    }

    /// A unit vector.
    pub(super) fn direction(&self, name: &'static str, value: [f64; 3]) -> Result<[f64; 3], SceneFault> {
        let value = self.point(name, value)?;
        let length = dot(value, value).sqrt();
        if !length.is_normal() {
            return Err(SceneFault::NoDirection { key: self.key(name) });
        }
        Ok(value.map(|c| c / length))
    }

    /// Linear RGB of `#rrggbb`.
    pub(super) fn color(&self, name: &'static str, text: &str) -> Result<[f64; 3], SceneFault> {
        let wrong = || SceneFault::Color { key: self.key(name), text: text.to_owned() };
        let digits =
            text.strip_prefix('#').filter(|d| d.len() == 6 && d.bytes().all(|b| b.is_ascii_hexdigit()));
        let code = u32::from_str_radix(digits.ok_or_else(wrong)?, 16).map_err(|_| wrong())?;
        Ok(linear_of([16, 8, 0].map(|shift| (code >> shift).to_le_bytes()[0])))
    }

    /// Light of some colour and strength.
    pub(super) fn light(
        &self,
        color: Option<&str>,
        strength: Option<f64>,
        usual: f64,
    ) -> Result<[f64; 3], SceneFault> {
        let color = color.map_or(Ok([1.0; 3]), |text| self.color("color", text))?;
        let strength = strength.map_or(Ok(usual), |v| self.number("strength", v, [0.0, STRONG]))?;
        Ok(color.map(|c| c * strength))
    }

    pub(super) fn not_both(
        &self,
        name: &'static str,
        given: bool,
        other: &'static str,
    ) -> Result<(), SceneFault> {
        if given { Err(SceneFault::Both { key: self.key(name), other }) } else { Ok(()) }
    }

    pub(super) fn unknown<'n>(
        &self,
        name: &'static str,
        given: &str,
        known: impl IntoIterator<Item = &'n str>,
    ) -> SceneFault {
        let known = known.into_iter().map(str::to_owned).collect();
        SceneFault::Unknown { key: self.key(name), name: given.to_owned(), known }
    }

    pub(super) fn few(&self, name: &'static str, count: usize, most: usize) -> Result<(), SceneFault> {
        if count > most { Err(SceneFault::TooMany { key: self.key(name), count, most }) } else { Ok(()) }
    }
}
