//! Points and directions of the patient as JSON: arrays of three numbers, mm.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use relief_base::{Patient, Point};

/// For `#[serde(with = "patient_mm")]` on a point.
pub(super) fn serialize<S: Serializer>(point: &Point<Patient>, serializer: S) -> Result<S::Ok, S::Error> {
    point.xyz.to_array().serialize(serializer)
}

/// See [`serialize`].
pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Point<Patient>, D::Error> {
    <[f64; 3]>::deserialize(deserializer).map(|[x, y, z]| Point::new(x, y, z))
}

/// For `#[serde(with = "patient_mm::array")]` on several points, however many a type has.
pub(super) mod array {
    use super::{Deserialize, Deserializer, Patient, Point, Serialize, Serializer};

    pub(in super::super) fn serialize<S: Serializer, P: AsRef<[Point<Patient>]>>(
        points: &P,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let points: Vec<[f64; 3]> = points.as_ref().iter().map(|point| point.xyz.to_array()).collect();
        points.serialize(serializer)
    }

    pub(in super::super) fn deserialize<'de, D: Deserializer<'de>, P: TryFrom<Vec<Point<Patient>>>>(
        deserializer: D,
    ) -> Result<P, D::Error> {
        let points = <Vec<[f64; 3]>>::deserialize(deserializer)?;
        let points: Vec<Point<Patient>> = points.into_iter().map(|[x, y, z]| Point::new(x, y, z)).collect();
        let count = points.len();
        P::try_from(points)
            .map_err(|_| serde::de::Error::custom(format!("{count} points are not as many as this kind has")))
    }
}
