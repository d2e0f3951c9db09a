//! The measured quantity of a model's values (SPEC 4.13), and its coding in `VALU`.

use super::error::{FormatError, damaged};

/// Longest name, unit or sign note, in bytes.
const MAX_TEXT: u64 = 200;

/// Map from values to colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum ColorMap {
    /// Blue below zero, light grey at zero, red above.
    Diverging,
    /// Viridis, dark violet to yellow.
    Sequential,
}

/// A measured quantity: at most one value per voxel or cell.
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
    /// Slope and intercept of stored values, such that `extent` is the greatest magnitude of signed values, or the
    /// greatest value of others.
    pub(crate) fn scale(&self, extent: f64) -> [f64; 2] {
        let extent = extent.max(f64::MIN_POSITIVE * 65_536.0);
        match self.map {
            ColorMap::Diverging => [extent / 32_767.0, -extent / 32_767.0 * 32_768.0],
            ColorMap::Sequential => [extent / 65_534.0, -extent / 65_534.0],
        }
    }

    /// Bytes of the section.
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

    /// Parses a section, which must be filled exactly.
    ///
    /// # Errors
    /// Unknown codes, ranges that are not finite or do not rise, texts that are too long or cut.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, FormatError> {
        Self::parsed(bytes)
            .ok_or_else(|| damaged("the quantity of the values cannot be read, or is impossible (SPEC I23)"))
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

/// Colours from one end of a map to the other, at even steps: the cool to warm map of Moreland 2009, and viridis.
const DIVERGING: [[u8; 3]; 9] = [
    [59, 76, 192],
    [98, 130, 234],
    [141, 176, 254],
    [184, 208, 249],
    [221, 221, 221],
    [245, 196, 173],
    [244, 154, 123],
    [222, 96, 77],
    [180, 4, 38],
];
const SEQUENTIAL: [[u8; 3]; 10] = [
    [68, 1, 84],
    [72, 40, 120],
    [62, 74, 137],
    [49, 104, 142],
    [38, 130, 142],
    [31, 158, 137],
    [53, 183, 121],
    [109, 205, 89],
    [180, 222, 44],
    [253, 231, 37],
];

impl ColorMap {
    /// Colour (sRGB) at a fraction of the way from the lowest to the highest value, clamped at both ends.
    pub(crate) fn color(self, part: f64) -> [u8; 3] {
        let stops: &[[u8; 3]] = if self == Self::Diverging { &DIVERGING } else { &SEQUENTIAL };
        let last = stops.len() - 1;
        let at = part.clamp(0.0, 1.0) * last as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let low = (at as usize).min(last - 1);
        let part = at - low as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let mixed = |c: usize| {
            let [low, high] = [stops[low][c], stops[low + 1][c]].map(f64::from);
            (low + part * (high - low)).round() as u8
        };
        [0, 1, 2].map(mixed)
    }
}

/// Colouring of stored values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueColors {
    map: ColorMap,
    /// Lowest and highest value of the map; a diverging one is symmetric around 0.
    pub(crate) range: [f64; 2],
    scale: [f64; 2],
}

impl ValueColors {
    /// Colour (sRGB) of cells without a value.
    pub(crate) const NONE: [u8; 3] = [128; 3];

    /// Colours for values of this slope and intercept, with the requested map and range, or else the quantity's own.
    pub(crate) fn new(
        quantity: &Quantity,
        scale: [f64; 2],
        map: Option<ColorMap>,
        range: Option<[f64; 2]>,
    ) -> Self {
        let (map, [lo, hi]) = (map.unwrap_or(quantity.map), range.unwrap_or(quantity.range));
        let reach = lo.abs().max(hi.abs());
        let range = if map == ColorMap::Diverging { [-reach, reach] } else { [lo, hi] };
        Self { map, range, scale }
    }

    /// Colour (sRGB) of a value.
    pub(crate) fn at(&self, value: f64) -> [u8; 3] {
        let [lo, hi] = self.range;
        self.map.color((value - lo) / (hi - lo))
    }

    /// Colour (sRGB) of a stored value.
    pub(crate) fn color(&self, stored: u16) -> [u8; 3] {
        measured_value(stored, self.scale).map_or(Self::NONE, |value| self.at(value))
    }
}

/// The stored form of a value: 0 for none, else the nearest of 1 to 65,535.
pub(crate) fn stored_value(value: Option<f64>, [slope, intercept]: [f64; 2]) -> u16 {
    let value = value.map(|value| (value - intercept) / slope).filter(|code| code.is_finite());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    value.map_or(0, |code| code.round().clamp(1.0, 65_535.0) as u16)
}

/// The value of a stored one; `None` for 0.
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
        let colors = ValueColors::new(&quantity, [1.0, 0.0], None, Some([-0.25, 1.0]));
        assert_eq!((colors.range, colors.at(0.0)), ([-1.0, 1.0], [221; 3]));
        assert_eq!((colors.at(-7.0), colors.at(7.0)), (DIVERGING[0], DIVERGING[8]));
        assert_eq!((colors.color(0), colors.at(0.5)), (ValueColors::NONE, DIVERGING[6]));
        assert_eq!((stored_value(None, [1.0, 0.0]), measured_value(0, [1.0, 0.0])), (0, None));
    }
}
