//! The quantity that the values of a model are (SPEC 4.13), and its code in `VALU`.

use super::error::FormatError;

/// Longest name, unit or sign note, in bytes.
const MAX_TEXT: u64 = 200;

/// How values become colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum ColorMap {
    /// Blue below zero, light grey at zero, red above.
    Diverging,
    /// Viridis, dark violet to yellow.
    Sequential,
}

/// A measured quantity: one value per voxel or cell, or none.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Quantity {
    /// Name, such as `deviation`.
    pub name: String,
    /// Unit, such as `mm`.
    pub unit: String,
    /// Meaning of the sign in words, such as `+ outside nominal`; empty if there is none.
    pub sign: String,
    /// Colour map.
    pub map: ColorMap,
    /// Lowest and highest value of the colour map, in the unit.
    pub range: [f64; 2],
    /// Lowest and highest value within the tolerance, if one was given.
    pub tolerance: Option<[f64; 2]>,
}

impl Quantity {
    /// Slope and intercept of stored values: the greatest magnitude of signed values, or the greatest value of others,
    /// is `extent`.
    pub(crate) fn scale(&self, extent: f64) -> [f64; 2] {
        let extent = extent.max(f64::MIN_POSITIVE * 65_536.0);
        match self.map {
            ColorMap::Diverging => [extent / 32_767.0, -extent / 32_767.0 * 32_768.0],
            ColorMap::Sequential => [extent / 65_534.0, -extent / 65_534.0],
        }
    }

    /// Content of the section.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = vec![self.map as u8, u8::from(self.tolerance.is_some()), 0, 0, 0, 0, 0, 0];
        let [tolerance, range] = [self.tolerance.unwrap_or_default(), self.range];
        bytes.extend(range.into_iter().chain(tolerance).flat_map(f64::to_le_bytes));
        for text in [&self.name, &self.unit, &self.sign] {
            bytes.extend((text.len() as u64).to_le_bytes());
            bytes.extend(text.as_bytes());
        }
        bytes
    }

    /// Reads a section, which must be filled exactly.
    ///
    /// # Errors
    /// Unknown codes, ranges that are not finite or do not rise, texts that are too long or cut.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, FormatError> {
        Self::parsed(bytes).ok_or(FormatError::Quantity { bytes: bytes.len() as u64 })
    }

    fn parsed(bytes: &[u8]) -> Option<Self> {
        let ([map, has_tolerance, zeros @ ..], mut rest) = bytes.split_first_chunk::<8>()?;
        let map = [ColorMap::Diverging, ColorMap::Sequential].into_iter().find(|m| *m as u8 == *map)?;
        let mut numbers = [0.0; 4];
        for number in &mut numbers {
            let (first, behind) = rest.split_first_chunk()?;
            (*number, rest) = (f64::from_le_bytes(*first), behind);
        }
        let [lo, hi, low, high] = numbers;
        let mut text = || {
            let (length, behind) = rest.split_first_chunk()?;
            let length = Some(u64::from_le_bytes(*length)).filter(|length| *length <= MAX_TEXT)?;
            let (text, behind) = behind.split_at_checked(usize::try_from(length).ok()?)?;
            rest = behind;
            String::from_utf8(text.to_vec()).ok()
        };
        let (name, unit, sign) = (text()?, text()?, text()?);
        let tolerance = match has_tolerance {
            0 if [low, high] == [0.0; 2] => None,
            1 if low <= high => Some([low, high]),
            _ => return None,
        };
        let is_sound =
            rest.is_empty() && *zeros == [0; 6] && numbers.iter().all(|n| n.is_finite()) && lo < hi;
        is_sound.then_some(Self { name, unit, sign, map, range: [lo, hi], tolerance })
    }
}

/// The stored form of a value: 0 for none, else the nearest of 1 to 65,535.
pub(crate) fn stored_value(value: Option<f64>, [slope, intercept]: [f64; 2]) -> u16 {
    let value = value.map(|value| (value - intercept) / slope).filter(|code| code.is_finite());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    value.map_or(0, |code| code.round().clamp(1.0, 65_535.0) as u16)
}

/// The value of a stored one; none for 0.
pub(crate) fn measured_value(stored: u16, [slope, intercept]: [f64; 2]) -> Option<f64> {
    (stored > 0).then(|| slope * f64::from(stored) + intercept)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantity_comes_back_and_every_cut_and_wrong_byte_is_found() {
        let quantity = Quantity {
            name: "deviation".into(),
            unit: "mm".into(),
            sign: "+ outside nominal".into(),
            map: ColorMap::Diverging,
            range: [-0.5, 0.5],
            tolerance: Some([-0.1, 0.2]),
        };
        let bytes = quantity.to_bytes();
        assert_eq!(Quantity::parse(&bytes), Ok(quantity.clone()));
        for len in 0..bytes.len() {
            assert!(Quantity::parse(&bytes[..len]).is_err(), "cut at {len}");
        }
        for (at, byte) in [(0, 2), (1, 0), (1, 2), (3, 1), (15, 0x7f), (31, 0x7f), (40, 201), (48, 0xff)] {
            let mut wrong = bytes.clone();
            wrong[at] = byte;
            assert!(Quantity::parse(&wrong).is_err(), "{byte} at {at}");
        }
        for (map, value, stored) in [
            (ColorMap::Diverging, 0.0, 32_768),
            (ColorMap::Diverging, -10.0, 1),
            (ColorMap::Diverging, 11.0, 65_535),
            (ColorMap::Sequential, 0.0, 1),
            (ColorMap::Sequential, 10.0, 65_535),
            (ColorMap::Sequential, f64::NAN, 0),
        ] {
            let scale = Quantity { map, ..quantity.clone() }.scale(10.0);
            assert_eq!(stored_value(Some(value), scale), stored, "{value}");
            let back = measured_value(stored, scale);
            assert!(back.is_none_or(|back| (back - value.min(10.0)).abs() < 1e-12), "{back:?}");
        }
        assert_eq!((stored_value(None, [1.0, 0.0]), measured_value(0, [1.0, 0.0])), (0, None));
    }
}
