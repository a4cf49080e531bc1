//! The axes of a tracker and of its tool, relative to those of the display and of a pointer: the
//! file of `relief client --tracker-geometry`.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::pose::SensorPose;

/// Tools are not farther away from their tracker, mm.
pub(crate) const FARTHEST_MM: f64 = 1e5;

/// Rigid transforms as rows of 4 x 4 matrices, mm. The display has x right, y up, z towards the
/// viewer. A pointer has the axes of a Wiimote: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackerGeometry {
    /// From the tracker's axes to those of the display.
    pub display_from_tracker: [[f64; 4]; 4],
    /// From the axes of a pointer to those of the tracked tool.
    pub tool_from_pointer: [[f64; 4]; 4],
}

/// A matrix that is not a rigid transform.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0} is not a rotation and a translation in mm: rows of a 4 x 4 matrix, the last one 0, 0, 0, 1")]
pub struct NotRigid(&'static str);

impl Default for TrackerGeometry {
    /// The tracker's axes are the display's, and the tool's are a pointer's.
    fn default() -> Self {
        let identity = std::array::from_fn(|row| std::array::from_fn(|column| f64::from(row == column)));
        Self { display_from_tracker: identity, tool_from_pointer: identity }
    }
}

/// A [`TrackerGeometry`] whose matrices are rigid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolPlacement {
    display_from_tracker: Isometry3<f64>,
    tool_from_pointer: Isometry3<f64>,
}

impl TrackerGeometry {
    /// Refuses matrices that scale, mirror or shear.
    ///
    /// # Errors
    /// The first such matrix.
    pub fn placement(&self) -> Result<ToolPlacement, NotRigid> {
        Ok(ToolPlacement {
            display_from_tracker: rigid("display_from_tracker", &self.display_from_tracker)?,
            tool_from_pointer: rigid("tool_from_pointer", &self.tool_from_pointer)?,
        })
    }
}

impl ToolPlacement {
    /// The pointer in the axes of the display, from the tool in the axes of the tracker.
    #[must_use]
    pub fn place(&self, tool: &SensorPose) -> SensorPose {
        let tracker_from_tool = Isometry3::from_parts(Translation3::from(tool.position), tool.orientation);
        let display_from_pointer = self.display_from_tracker * tracker_from_tool * self.tool_from_pointer;
        SensorPose {
            position: display_from_pointer.translation.vector,
            orientation: display_from_pointer.rotation,
        }
    }

    /// The tool's target on the plane of the display: to the right and up from the origin of the
    /// display's axes, mm; `None` when it points away from the display.
    #[must_use]
    pub fn aim(&self, tool: &SensorPose) -> Option<[f64; 2]> {
        let pointer = self.place(tool);
        let forward = pointer.orientation * Vector3::z();
        let along = -pointer.position.z / forward.z;
        let is_towards = pointer.position.z > 0.0 && forward.z < -1e-6;
        let point = pointer.position + forward * along;
        is_towards.then_some([point.x, point.y])
    }
}

fn rigid(name: &'static str, rows: &[[f64; 4]; 4]) -> Result<Isometry3<f64>, NotRigid> {
    let turn = Matrix3::from_fn(|row, column| rows[row][column]);
    let translation = Vector3::from_fn(|row, _| rows[row][3]);
    let is_turn = is_rotation(&turn) && translation.iter().all(|mm| mm.abs() < FARTHEST_MM);
    if !is_turn || rows[3] != [0.0, 0.0, 0.0, 1.0] {
        return Err(NotRigid(name));
    }
    Ok(Isometry3::from_parts(translation.into(), quaternion(&turn)))
}

/// Whether a matrix turns, and does nothing else, within the rounding of 32-bit numbers and of files.
pub(crate) fn is_rotation(turn: &Matrix3<f64>) -> bool {
    (turn * turn.transpose() - Matrix3::identity()).iter().all(|number| number.abs() < 1e-3)
        && turn.determinant() > 0.0
}

/// The nearest rotation.
pub(crate) fn quaternion(turn: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(turn))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tools_are_placed_before_the_display() {
        // A tracker on the ceiling, whose z points down, and a tool that points along its x axis.
        let geometry = TrackerGeometry {
            display_from_tracker: [
                [1.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, -1.0, 1000.0],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
            tool_from_pointer: [
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 1.0, 0.0, 0.0],
                [-1.0, 0.0, 0.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
        };
        let tool =
            SensorPose { position: Vector3::new(10.0, 20.0, 300.0), orientation: UnitQuaternion::identity() };
        let placed = geometry.placement().unwrap().place(&tool);
        assert!((placed.position - Vector3::new(10.0, 700.0, 20.0)).norm() < 1e-9, "{placed:?}");
        let forward = placed.orientation * Vector3::z();
        assert!((forward - Vector3::x()).norm() < 1e-9, "{forward}");
        assert_eq!(TrackerGeometry::default().placement().unwrap().place(&tool), tool);
    }

    #[test]
    fn a_tool_aims_where_its_ray_meets_the_display() {
        let placement = TrackerGeometry::default().placement().unwrap();
        let facing = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let aim = |position: [f64; 3], orientation| {
            placement.aim(&SensorPose { position: position.into(), orientation })
        };
        assert_eq!(aim([30.0, -40.0, 900.0], facing).map(|at| at.map(f64::round)), Some([30.0, -40.0]));
        // Turned by atan(0.5) to the viewer's left.
        let left = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.5_f64.atan()) * facing;
        let [x, y] = aim([0.0, 0.0, 1000.0], left).unwrap();
        assert!((x + 500.0).abs() < 1e-9 && y.abs() < 1e-9, "{x} {y}");
        assert_eq!(aim([0.0, 0.0, 1000.0], UnitQuaternion::identity()), None, "away from the display");
        assert_eq!(aim([0.0, 0.0, -10.0], facing), None, "behind the display");
    }

    #[test]
    fn matrices_that_mirror_or_scale_are_refused() {
        let mut mirrored = TrackerGeometry::default();
        mirrored.display_from_tracker[0][0] = -1.0;
        assert_eq!(mirrored.placement(), Err(NotRigid("display_from_tracker")));
        let mut scaled = TrackerGeometry::default();
        scaled.tool_from_pointer[1][1] = 1000.0;
        assert_eq!(scaled.placement(), Err(NotRigid("tool_from_pointer")));
        let mut endless = TrackerGeometry::default();
        endless.tool_from_pointer[1][3] = f64::NAN;
        assert_eq!(endless.placement(), Err(NotRigid("tool_from_pointer")));
    }
}
