//! Named points of a picture that lie outside of the depth that the display shows: there they have
//! the depth of its end, and look wrong.

use relief_base::DepthLimits;
use relief_live::OutsideDepth;
use relief_render::{Landmark, Mode, OverlayItem, Overlays, RenderRequest};
use relief_volume::Camera;

/// The named points outside of these limits, if there are any. Names themselves are kept where
/// they can be read.
pub(super) fn outside_depth(request: &RenderRequest, limits: DepthLimits) -> Option<OutsideDepth> {
    let is_flat = matches!(request.mode, Mode::Slice(_));
    if is_flat { None } else { farthest_outside(&request.camera, &request.overlays, limits) }
}

fn farthest_outside(camera: &Camera, overlays: &Overlays, limits: DepthLimits) -> Option<OutsideDepth> {
    let view_from_patient = camera.view_from_patient();
    let outside = overlays.items.iter().filter_map(|item| {
        let OverlayItem::Landmark(Landmark { at, label: Some(label), .. }) = item else { return None };
        let depth_mm = -(view_from_patient * *at).xyz.z;
        let behind_mm = depth_mm - depth_mm.clamp(limits.near_mm, limits.far_mm);
        (behind_mm != 0.0).then_some((label, behind_mm))
    });
    let count = outside.clone().count();
    let (label, behind_mm) = outside.max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()))?;
    // Whole millimetres: limits that settle change the message less often.
    Some(OutsideDepth { count, label: label.to_string(), behind_mm: behind_mm.round() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_base::{Patient, Point, Vector};
    use relief_render::Radius;
    use relief_volume::Projection;
    use std::sync::Arc;

    #[test]
    fn the_point_farthest_outside_is_named_and_unnamed_ones_do_not_count() {
        // From the front: a point 20 mm towards the eye has a view depth of 980 mm.
        let camera = Camera::new(
            Point::<Patient>::new(0.0, -1000.0, 0.0),
            Point::new(0.0, 0.0, 0.0),
            Vector::new(0.0, 0.0, 1.0),
            Projection::Orthographic { height_mm: 200.0 },
        )
        .expect("a camera");
        let ball = |y: f64, label: Option<&str>| {
            OverlayItem::Landmark(Landmark {
                at: Point::new(3.0, y, -7.0),
                radius: Radius::Px(5.0),
                rgb: [1.0; 3],
                label: label.map(Arc::from),
            })
        };
        let items = vec![
            ball(0.0, Some("inside")),
            ball(50.0, Some("end")),
            ball(-62.4, Some("tip")),
            ball(58.0, Some("back")),
            ball(-400.0, None),
        ];
        let overlays = Overlays { items, ..Overlays::default() };
        let found = |near_mm, far_mm| farthest_outside(&camera, &overlays, DepthLimits { near_mm, far_mm });
        let tip = OutsideDepth { count: 2, label: "tip".to_owned(), behind_mm: -12.0 };
        assert_eq!(found(950.0, 1050.0), Some(tip));
        let back = OutsideDepth { count: 1, label: "back".to_owned(), behind_mm: 8.0 };
        assert_eq!(found(900.0, 1050.0), Some(back));
        assert_eq!(found(900.0, 1060.0), None);
    }
}
