//! Studies: how accurately people annotate, how well readers agree, how many viewers a server carries.

mod agreement;

pub use agreement::{
    Absence, Agreement, AgreementError, BlandAltman, Comparison, Ellipsoid, ErrorSummary, Figure, Icc,
    Landmark, MeasureRow, Missing, Pairing, Placed, Reading, ReadingErrors, ReadingMeasures, Relation, Study,
    Undefined, bland_altman, compare_readings, icc_2_1,
};
