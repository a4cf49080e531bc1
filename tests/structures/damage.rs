//! Mesh files that are damaged or made up: an error with its place, or a mesh that is sound; never
//! more memory than bytes.

use proptest::prelude::*;
use relief_annotation::{MeshFilePlace, MeshFormat, TriangleMesh, read_mesh, surface_nets, write_mesh};

use super::shapes::noise;

fn mesh() -> TriangleMesh {
    surface_nets(&noise([4, 3, 3], 40, 3)).unwrap()
}

fn says(format: MeshFormat, bytes: impl AsRef<[u8]>, text: &str) {
    let refused = read_mesh(format, bytes.as_ref()).unwrap_err().to_string();
    assert!(refused.contains(text), "{refused}");
}

#[test]
fn lines_bytes_and_keys_are_named() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    assert_eq!(read_mesh(MeshFormat::Ply, ply.as_bytes()).unwrap().mesh.triangles, [[0, 1, 2]]);
    says(MeshFormat::Ply, ply.replace("1 0 0", "1 zero 0"), "ply, line 11: found zero, expected a number");
    says(
        MeshFormat::Ply,
        ply.replace("3 0 1 2", "3 0 1 3"),
        "line 13: found 3, expected a corner, from 0 to 3",
    );
    says(MeshFormat::Ply, ply.replace("3 0 1 2", "2 0 1"), "line 13: found a face of 2 corners");
    says(MeshFormat::Ply, ply.replace("3 0 1 2\n", ""), "line 12: found the end");
    says(MeshFormat::Ply, ply.replace("float z", "flood z"), "line 6: found property flood z");
    says(MeshFormat::Ply, ply.replace("property float z\n", ""), "no property z of element vertex");
    says(MeshFormat::Ply, ply.replace("end_header", "comment"), "expected format, comment, element");
    says(MeshFormat::Ply, "play\n", "line 1: found play, expected ply");
    says(MeshFormat::Ply, ply.replace("vertex 3", "vertex 18446744073709551615"), "ply, line 1");
    says(MeshFormat::Ply, "ply\nformat ascii 1.0\ncomment x\n", "no end_header");

    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/4 -2//3 3\n";
    assert_eq!(read_mesh(MeshFormat::Obj, obj.as_bytes()).unwrap().mesh.triangles, [[0, 1, 2]]);
    says(
        MeshFormat::Obj,
        obj.replace("v 1 0 0", "v 1 inf 0"),
        "obj, line 2: found inf, expected a finite number",
    );
    says(MeshFormat::Obj, obj.replace(" 3\n", " 4\n"), "line 4: found corner 4, expected one of the 3");
    says(MeshFormat::Obj, obj.replace("1/4", "0"), "line 4: found 0, expected the number of a corner");
    says(MeshFormat::Obj, obj.replace(" 3\n", "\n"), "a face of three corners");
    says(MeshFormat::Obj, "nothing\n", "found no triangle");

    let stl = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
    assert_eq!(read_mesh(MeshFormat::Stl, stl.as_bytes()).unwrap().mesh.triangles, [[0, 1, 2]]);
    says(
        MeshFormat::Stl,
        stl.replace("vertex 1 0 0", "vertex 1 0"),
        "stl, line 5: found the end of the line",
    );
    says(
        MeshFormat::Stl,
        stl.replace("vertex 1 0 0\n", ""),
        "line 7: found endfacet, expected three vertices",
    );
    says(MeshFormat::Stl, stl.replace("outer", "inner"), "line 3: found inner loop");
    let binary = write_mesh(MeshFormat::Stl, &mesh(), "").unwrap();
    says(MeshFormat::Stl, &binary[..binary.len() - 1], "byte 84: found");
    says(
        MeshFormat::Stl,
        &binary[..50],
        "byte 0: found the end after 50 bytes, expected 80 bytes of the header",
    );

    let glb = write_mesh(MeshFormat::Glb, &mesh(), "a").unwrap();
    let changed = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let at = glb.windows(from.len()).position(|part| part == from.as_bytes()).unwrap();
        [&glb[..at], to.as_bytes(), &glb[at + from.len()..]].concat()
    };
    says(MeshFormat::Glb, changed("\"mesh\":0", "\"mesh\":7"), "glb, meshes[7]: found no such mesh");
    says(
        MeshFormat::Glb,
        changed("\"POSITION\":0", "\"POSITION\":1"),
        "accessors[1]: found SCALAR of 5125, expected VEC3",
    );
    says(MeshFormat::Glb, changed("\"buffer\":0", "\"buffer\":1"), "bufferView: found none in the file");
    says(MeshFormat::Glb, changed("\"mode\":4", "\"mode\":1"), "found only points and lines");
    says(MeshFormat::Glb, changed("\"nodes\":[0]", "\"nodes\":0  "), "invalid type");
    says(MeshFormat::Glb, b"{\"asset\":{}}....", "byte 0");
    says(MeshFormat::Glb, &glb[..60], "byte 20: found the end");
}

#[test]
fn nodes_in_a_ring_and_meshes_shown_too_often_end() {
    let glb = write_mesh(MeshFormat::Glb, &mesh(), "a").unwrap();
    let size = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let with = |nodes: &str| {
        let mut json: serde_json::Value = serde_json::from_slice(&glb[20..20 + size]).unwrap();
        json["nodes"] = serde_json::from_str(nodes).unwrap();
        let json = json.to_string().into_bytes();
        [&glb[..12], &(json.len() as u32).to_le_bytes(), b"JSON", &json, &glb[20 + size..]].concat()
    };
    says(MeshFormat::Glb, with(r#"[{"children":[0]}]"#), "nodes without end");
    let many: Vec<String> = std::iter::repeat_n(r#"{"mesh":0}"#.to_owned(), 3000).collect();
    let children: Vec<String> = (1..=3000).map(|n| n.to_string()).collect();
    let many = format!(r#"[{{"children":[{}]}},{}]"#, children.join(","), many.join(","));
    says(MeshFormat::Glb, with(&many), "no more than the file has bytes");
    // A node that mirrors turns triangles inside out, so they are turned back; metres and Y up
    // become mm and LPS.
    let mirrored = read_mesh(
        MeshFormat::Glb,
        &with(r#"[{"mesh":0,"scale":[-0.001,0.001,0.001],"translation":[1,0,0]}]"#),
    );
    let (own, found) = (mesh().measures(), mirrored.unwrap().mesh);
    assert!((found.measures().volume_ml.unwrap() - own.volume_ml.unwrap()).abs() < 1e-6);
    let [[low, high], [own_low, own_high]] = [found.span(), mesh().span()];
    let expected =
        [[1000.0 - own_high.x, -own_high.z, own_low.y], [1000.0 - own_low.x, -own_low.z, own_high.y]];
    assert!((low - glam::DVec3::from(expected[0])).length() < 1e-3, "{low} for {expected:?}");
    assert!((high - glam::DVec3::from(expected[1])).length() < 1e-3, "{high} for {expected:?}");
}

/// A mesh that was read can be used: no corner is missing, none is nowhere.
fn is_sound(format: MeshFormat, bytes: &[u8]) {
    match read_mesh(format, bytes) {
        Ok(found) => {
            found.mesh.check().unwrap();
            assert!(found.mesh.triangles.len() <= bytes.len() && found.mesh.vertices.len() <= bytes.len());
            let _ = found.mesh.measures();
        }
        Err(error) => {
            assert!(error.to_string().len() < 400, "{error}");
            if let MeshFilePlace::Byte(at) = error.at {
                assert!(at <= bytes.len());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_bytes_end_well(bytes in proptest::collection::vec(any::<u8>(), 0..400), begins in 0..6usize) {
        let head: &[u8] = [
            b"".as_slice(), b"solid ", b"ply\nformat binary_little_endian 1.0\n", b"v 1 2 3\nf ", b"glTF\x02\0\0\0",
            b"ply\nformat ascii 1.0\nelement vertex 9\nproperty list uchar float x\n",
        ][begins];
        for format in MeshFormat::ALL {
            is_sound(format, &[head, &bytes].concat());
        }
    }

    /// Invariant: A region that leaks is refused and nothing is stored; a mesh file is valid, or
    /// refused with the place of the error.
    #[test]
    fn damaged_files_end_well(places in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
                              cut in any::<prop::sample::Index>(), which in 0..4usize, is_cut in any::<bool>()) {
        let format = MeshFormat::ALL[which];
        let mut bytes = write_mesh(format, &mesh(), "name").unwrap();
        for (place, value) in places {
            let at = place.index(bytes.len());
            bytes[at] = value;
        }
        if is_cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        is_sound(format, &bytes);
    }
}
