//! The quantity of a volume's values. Presets, windows, the table and the anatomy apply to Hounsfield
//! units only.

/// The quantity that the values of a volume measure: Rescale Type (0028,1054) of PS3.3 C.11.1.1.2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// Hounsfield units, the default of CT.
    #[default]
    Hounsfield,
    /// Modified Hounsfield units, for example of virtual non-contrast images.
    ModifiedHounsfield,
    /// Optical density.
    OpticalDensity,
    /// Material density, mg/ml, for example of iodine.
    Concentration,
    /// Effective atomic number.
    EffectiveAtomicNumber,
    /// Electron density, 10²³/ml.
    ElectronDensity,
    /// Electron density relative to water.
    RelativeElectronDensity,
    /// Per cent.
    Percent,
    /// Unspecified, or a Rescale Type that the standard does not define.
    Unspecified,
}

impl Quantity {
    const NAMES: [(Self, &'static str); 9] = [
        (Self::Hounsfield, "HU"),
        (Self::ModifiedHounsfield, "HU_MOD"),
        (Self::OpticalDensity, "OD"),
        (Self::Concentration, "MGML"),
        (Self::EffectiveAtomicNumber, "Z_EFF"),
        (Self::ElectronDensity, "ED"),
        (Self::RelativeElectronDensity, "EDW"),
        (Self::Percent, "PCT"),
        (Self::Unspecified, "US"),
    ];

    /// The quantity of a Rescale Type; [`Quantity::Unspecified`] for a name that the standard does not
    /// define. Such a name is not kept: it is free text.
    #[must_use]
    pub fn of_rescale_type(name: &str) -> Self {
        let known = Self::NAMES.into_iter().find(|(_, known)| *known == name);
        known.map_or(Self::Unspecified, |(quantity, _)| quantity)
    }

    /// Its Rescale Type, which names the unit in answers.
    #[must_use]
    pub fn unit(self) -> &'static str {
        Self::NAMES.into_iter().find(|(known, _)| *known == self).map_or("US", |(_, name)| name)
    }

    /// Whether the values are Hounsfield units.
    #[must_use]
    pub fn is_hu(self) -> bool {
        self == Self::Hounsfield
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_of_the_standard_comes_back_and_others_are_unspecified() {
        for name in ["HU", "HU_MOD", "OD", "MGML", "Z_EFF", "ED", "EDW", "PCT", "US"] {
            assert_eq!(Quantity::of_rescale_type(name).unit(), name);
            assert_eq!(Quantity::of_rescale_type(name).is_hu(), name == "HU");
        }
        assert_eq!(Quantity::of_rescale_type("Somebody^Else"), Quantity::Unspecified);
    }
}
