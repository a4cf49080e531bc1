//! Studies: the accuracy of annotation, the agreement between readers, and the capacity of a
//! server.
//!
//! Simulations, statistics and measurements, as values. Arguments, files and plots are in
//! `relief_cli`.
//!
//! | module | question |
//! |---|---|
//! | `accuracy` | how far from a landmark does a simulated user place it? |
//! | `agreement` | how well do several readers agree with each other and with a reference? |
//! | `capacity` | how many viewers does this machine serve, and how many machines do more need? |
//!
//! Lengths in patient LPS mm.

mod accuracy;
mod agreement;
mod capacity;
mod error;

pub use crate::accuracy::report::WayReport;
pub use accuracy::{AccuracyReport, AccuracySettings, PointerKind, measure_accuracy};
pub use agreement::{
    Absence, Agreement, AgreementError, BlandAltman, Comparison, Ellipsoid, ErrorSummary, Figure, Icc,
    Landmark, MeasureRow, Missing, Pairing, Placed, Reading, ReadingErrors, ReadingMeasures, Relation, Study,
    Undefined, bland_altman, compare_readings, icc_2_1,
};
pub use capacity::{
    Capacity, CapacityMeasurement, FrameRates, GroupNeeds, ViewerHabits, measure_capacity, process_mib,
};
pub use error::StudyError;
