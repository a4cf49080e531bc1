//! The stable form of a request: bytes that are equal where requests are, in every process and on
//! every machine.
//!
//! Names of pictures, such as entity tags, on which two servers agree. The bytes cannot be decoded;
//! the readable form is the JSON of `scene`. Every struct is destructured, so that the compiler
//! reports a forgotten field.
//!
//! Numbers are little-endian, and -0 is 0. Texts and lists begin with their length, enums with
//! their name, and options with whether they are present. So two different requests have different
//! bytes.

use super::chosen::ChosenBlocks;
use super::cut::CutFaces;
use super::detail::Detail;
use super::display_depth::ForViews;
use super::illumination::{Illumination, Occlusion};
use super::labels::{Labels, Look};
use super::light::{Light, Placement};
use super::mode::Mode;
use super::overlay::{Curve, Landmark, Line, Mesh, OverlayItem, Overlays, Radius, Text};
use super::pathtrace::PathTrace;
use super::request::{Clip, ClipPlane, ClipSphere, DepthRule, RenderRequest, Shading};
use super::surface::Surface;
use relief_base::{Point, Space, Vector};
use relief_volume::{Camera, Projection, TransferFunction};

impl RenderRequest {
    /// Bytes that are equal where requests are, in every process; see the module.
    #[must_use]
    pub fn stable_bytes(&self) -> Vec<u8> {
        let mut form = FingerprintBytes(Vec::with_capacity(1024 + self.overlays.size_bytes()));
        form.request(self);
        form.0
    }
}

/// The bytes so far.
struct FingerprintBytes(Vec<u8>);

impl FingerprintBytes {
    fn numbers(&mut self, numbers: &[f64]) {
        for number in numbers {
            self.0.extend((number + 0.0).to_le_bytes()); // -0 is 0
        }
    }

    fn count(&mut self, count: usize) {
        self.0.extend((count as u64).to_le_bytes());
    }

    fn side(&mut self, side: u32) {
        self.0.extend(side.to_le_bytes());
    }

    fn flag(&mut self, flag: bool) {
        self.0.push(flag.into());
    }

    fn text(&mut self, text: &str) {
        self.count(text.len());
        self.0.extend(text.as_bytes());
    }

    fn list<T>(&mut self, items: &[T], mut each: impl FnMut(&mut Self, &T)) {
        self.count(items.len());
        items.iter().for_each(|item| each(self, item));
    }

    fn maybe<T>(&mut self, value: Option<T>, write: impl FnOnce(&mut Self, T)) {
        self.flag(value.is_some());
        if let Some(value) = value {
            write(self, value);
        }
    }

    fn point<S: Space>(&mut self, point: Point<S>) {
        self.numbers(&point.xyz.to_array());
    }

    fn vector<S: Space>(&mut self, vector: Vector<S>) {
        self.numbers(&vector.xyz.to_array());
    }

    fn request(&mut self, request: &RenderRequest) {
        let RenderRequest {
            camera,
            size_px,
            reduced_px,
            mode,
            transfer,
            classification,
            surfaces,
            shading,
            sample_distance_mm,
            detail,
            slab_mm,
            letters,
            depth,
            for_views,
            needs_depth,
            clip,
            cut,
            table,
            labels,
            blocks,
            background_rgb,
            overlays,
            lights,
            illumination,
            path_trace,
        } = request;
        self.camera(camera);
        size_px.iter().for_each(|side| self.side(*side));
        self.maybe(*reduced_px, |form, sides| sides.iter().for_each(|side| form.side(*side)));
        self.mode(*mode);
        self.transfer(transfer);
        self.text(classification.name());
        self.list(surfaces, |form, Surface { hu, rgb, opacity }| {
            form.numbers(&[*hu, *opacity]);
            form.numbers(rgb);
        });
        let Shading { ambient, diffuse, specular, shininess } = shading;
        self.numbers(&[*ambient, *diffuse, *specular, *shininess]);
        self.numbers(&[*sample_distance_mm, *slab_mm]);
        self.flag(*letters);
        self.depth(*depth);
        self.clip(clip);
        self.text(table.name());
        self.maybe(labels.as_deref(), Self::labels);
        self.numbers(background_rgb);
        self.overlays(overlays);
        self.list(lights, Self::light);
        let Illumination { shadows, occlusion: Occlusion { strength, radius_mm } } = illumination;
        self.numbers(&[*shadows, *strength, *radius_mm]);
        self.path_trace(path_trace);
        self.unusual(*detail, blocks.as_deref(), *needs_depth);
        self.faces_and_caption(*cut, overlays.caption.as_deref());
        self.for_views(for_views.as_ref());
    }

    fn path_trace(&mut self, path_trace: &PathTrace) {
        let PathTrace {
            passes,
            seed,
            density,
            environment,
            exposure,
            anisotropy,
            surface,
            surface_hu_per_mm,
            scatterings,
            denoise,
        } = path_trace;
        self.side(*passes);
        self.side(*seed);
        self.side(*scatterings);
        self.side(u32::from(*denoise));
        self.numbers(&[*density, *environment, *exposure, *anisotropy, *surface, *surface_hu_per_mm]);
    }

    /// Last, and only where they are not the usual ones: names of other pictures stay.
    fn unusual(&mut self, detail: Detail, blocks: Option<&ChosenBlocks>, needs_depth: bool) {
        if detail == Detail::Coarse {
            self.text("coarse");
        }
        if let Some(blocks) = blocks {
            self.text("blocks");
            self.list(blocks.flags(), |form, flag| form.flag(*flag));
        }
        if !needs_depth {
            self.text("without depth");
        }
    }

    /// As [`Self::unusual`].
    fn faces_and_caption(&mut self, cut: CutFaces, caption: Option<&str>) {
        if let CutFaces::Slice { window_hu } = cut {
            self.text("cut slice");
            self.numbers(&window_hu);
        }
        if let Some(caption) = caption {
            self.text("caption");
            self.text(caption);
        }
    }

    /// As [`Self::unusual`]. JSON has all settings of the display in a fixed order.
    fn for_views(&mut self, for_views: Option<&ForViews>) {
        if let Some(ForViews { display, casts_views }) = for_views {
            self.text("for views");
            self.flag(*casts_views);
            self.text(&serde_json::to_string(&**display).unwrap_or_default()); // it cannot fail
        }
    }

    fn camera(&mut self, camera: &Camera) {
        self.point(camera.eye());
        self.point(camera.look_at());
        self.vector(camera.up());
        match camera.projection() {
            Projection::Perspective { vertical_fov } => {
                self.text("perspective");
                self.numbers(&[vertical_fov]);
            }
            Projection::Orthographic { height_mm } => {
                self.text("orthographic");
                self.numbers(&[height_mm]);
            }
        }
        self.numbers(&camera.lens_shift());
    }

    fn mode(&mut self, mode: Mode) {
        self.text(mode.name());
        let blend = if let Mode::Slice(blend) = mode { Some(blend) } else { None };
        self.maybe(blend, |form, blend| form.text(blend.name()));
    }

    fn transfer(&mut self, transfer: &TransferFunction) {
        self.numbers(&[transfer.opacity_unit_mm()]);
        self.list(transfer.points(), |form, point| {
            form.numbers(&[point.hu]);
            form.numbers(&point.rgba);
        });
        self.maybe(transfer.gradient_opacity(), |form, opacity| {
            form.list(opacity.points(), |form, point| form.numbers(point));
        });
    }

    fn depth(&mut self, depth: DepthRule) {
        self.text(depth.name());
        self.maybe(depth.fraction(), |form, fraction| form.numbers(&[fraction]));
    }

    fn clip(&mut self, Clip { planes, sphere }: &Clip) {
        self.list(planes, |form, ClipPlane { point, normal }| {
            form.point(*point);
            form.vector(*normal);
        });
        self.maybe(sphere.as_ref(), |form, ClipSphere { center, radius_mm }| {
            form.point(*center);
            form.numbers(&[*radius_mm]);
        });
    }

    fn labels(&mut self, Labels { map, looks, transfers, edges }: &Labels) {
        self.0.extend(map.content_hash().0);
        self.list(looks, |form, Look { visible, transfer, tint_rgb, tint }| {
            form.flag(*visible);
            form.count(*transfer);
            form.numbers(tint_rgb);
            form.numbers(&[*tint]);
        });
        self.list(transfers, Self::transfer);
        self.text(edges.name());
    }

    fn light(&mut self, Light { placement, rgb, intensity, size }: &Light) {
        match placement {
            Placement::ViewDirection(vector) => {
                self.text("view direction");
                self.vector(*vector);
            }
            Placement::ViewPosition(point) => {
                self.text("view position");
                self.point(*point);
            }
            Placement::PatientDirection(vector) => {
                self.text("patient direction");
                self.vector(*vector);
            }
            Placement::PatientPosition(point) => {
                self.text("patient position");
                self.point(*point);
            }
        }
        self.numbers(rgb);
        self.numbers(&[*intensity, *size]);
    }

    fn overlays(&mut self, overlays: &Overlays) {
        let Overlays {
            items,
            bounding_box,
            orientation_cube,
            scale_bar,
            caption: _, // among the unusual
            label_height_px,
            label_depths_mm,
            occluded,
        } = overlays;
        [*bounding_box, *orientation_cube, *scale_bar].into_iter().for_each(|flag| self.flag(flag));
        self.maybe(*label_height_px, Self::side);
        self.maybe(label_depths_mm.as_ref(), |form, depths| form.numbers(depths));
        self.numbers(&[*occluded]);
        self.list(items, Self::overlay);
    }

    fn overlay(&mut self, item: &OverlayItem) {
        self.text(item.kind());
        match item {
            OverlayItem::Landmark(Landmark { at, radius, rgb, label }) => {
                self.point(*at);
                let (name, size) = match *radius {
                    Radius::Mm(mm) => ("mm", mm),
                    Radius::Px(px) => ("px", px),
                };
                self.text(name);
                self.numbers(&[size]);
                self.numbers(rgb);
                self.maybe(label.as_deref(), Self::text);
            }
            OverlayItem::Line(Line { ends, width_px, rgb }) => {
                ends.iter().for_each(|end| self.point(*end));
                self.numbers(&[*width_px]);
                self.numbers(rgb);
            }
            OverlayItem::Curve(Curve { points, closed, smooth, width_px, rgb }) => {
                self.list(points, |form, point| form.point(*point));
                self.flag(*closed);
                self.flag(*smooth);
                self.numbers(&[*width_px]);
                self.numbers(rgb);
            }
            OverlayItem::Mesh(Mesh { vertices, triangles, rgb, opacity }) => {
                self.list(vertices, |form, vertex| form.point(*vertex));
                self.list(triangles, |form, corners| corners.iter().for_each(|corner| form.side(*corner)));
                self.numbers(rgb);
                self.numbers(&[*opacity]);
            }
            OverlayItem::Text(Text { at, text, height_px, rgb }) => {
                self.point(*at);
                self.text(text);
                self.maybe(*height_px, Self::side);
                self.numbers(rgb);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::SceneFile;
    use relief_volume::{Grid, Orbit};

    fn bytes(json: &str) -> Vec<u8> {
        let grid = Grid::axis_aligned([10; 3], [1.0; 3], [0.0; 3]).unwrap();
        let file = SceneFile::parse(json.as_bytes()).unwrap();
        file.resolve(&grid, &Orbit::default()).unwrap().request.stable_bytes()
    }

    #[test]
    fn equal_requests_have_equal_bytes_and_every_change_has_others() {
        let landmark =
            |rest: &str| format!(r#"{{"overlays":{{"items":[{{"landmark":{{"at_mm":[1,2,3]{rest}}}}}]}}}}"#);
        let two = |first: &str, second: &str| {
            let text = |text: &str| format!(r#"{{"text":{{"at_mm":[0,0,0],"text":"{text}"}}}}"#);
            format!(r#"{{"overlays":{{"items":[{},{}]}}}}"#, text(first), text(second))
        };
        let scenes = [
            "{}".to_owned(),
            r#"{"size_px":[20,30]}"#.to_owned(),
            r#"{"size_px":[30,20]}"#.to_owned(),
            r#"{"mode":"mip"}"#.to_owned(),
            r#"{"mode":"slice","slice":{"plane":"axial","slab_mm":5}}"#.to_owned(),
            r#"{"mode":"slice","slice":{"plane":"axial","slab_mm":5,"blend":"mip"}}"#.to_owned(),
            r#"{"mode":"isosurface","iso_hu":300}"#.to_owned(),
            r#"{"mode":"isosurface","iso_hu":301}"#.to_owned(),
            r#"{"mode":"path-traced","path_trace":{"seed":7}}"#.to_owned(),
            r#"{"mode":"path-traced","path_trace":{"passes":7}}"#.to_owned(),
            r#"{"mode":"path-traced","path_trace":{"scatterings":7}}"#.to_owned(),
            r#"{"mode":"path-traced","path_trace":{"denoise":true}}"#.to_owned(),
            r#"{"transfer":"skin"}"#.to_owned(),
            r#"{"depth":{"rule":"threshold","fraction":0.25}}"#.to_owned(),
            r#"{"depth":{"rule":"two-layer","fraction":0.25}}"#.to_owned(),
            r#"{"classification":"pre-integrated"}"#.to_owned(),
            r#"{"sample_distance_mm":2}"#.to_owned(),
            r#"{"background_rgb":[0,0,0.001]}"#.to_owned(),
            r#"{"clip":{"planes":[{"point_mm":[0,0,0],"normal":[1,0,0]}]}}"#.to_owned(),
            r#"{"clip":{"planes":[{"point_mm":[1,0,0],"normal":[1,0,0]}]}}"#.to_owned(),
            r#"{"cut":"slice"}"#.to_owned(),
            r#"{"cut":{"slice":{"window_hu":[40,401]}}}"#.to_owned(),
            r#"{"overlays":{"scale_bar":true}}"#.to_owned(),
            r#"{"overlays":{"orientation_cube":true}}"#.to_owned(),
            landmark(""),
            landmark(r#","radius_px":5"#),
            landmark(r#","radius_mm":5"#),
            landmark(r#","label":"a""#),
            two("ab", "c"),
            two("a", "bc"),
        ];
        let all: std::collections::BTreeSet<_> = scenes.iter().map(|scene| bytes(scene)).collect();
        assert_eq!(all.len(), scenes.len());
        scenes.iter().for_each(|scene| assert_eq!(bytes(scene), bytes(scene), "{scene}"));
        assert_eq!(bytes(r#"{"background_rgb":[-0.0,0,0]}"#), bytes(r#"{"background_rgb":[0,0,0]}"#));
    }
}
