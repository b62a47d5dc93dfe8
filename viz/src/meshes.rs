//! The meshes that an arm's file names, out of their files: STL, OBJ and COLLADA.

use std::collections::{BTreeMap, BTreeSet};
use std::env::{split_paths, var_os};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::{Path, PathBuf};

use glam::Vec3;
use mesh_loader::{Loader, Scene};
use model::{Geometry, Robot};
use quick_xml::Reader;
use quick_xml::events::Event;

use crate::body::Mesh;

/// Where ROS looks for packages, and where in each of these folders.
const PACKAGES: [(&str, &str); 2] = [("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")];

/// The readable meshes, by the name in the robot's file.
#[derive(Default)]
pub(crate) struct Meshes(BTreeMap<String, Scene>);

impl Meshes {
    /// Those of an arm; and a sentence about those that are lacking.
    pub(crate) fn of(robot: &Robot) -> (Self, Option<String>) {
        let shapes = robot.shapes.iter();
        let files = shapes.filter_map(|shape| match &shape.geometry {
            Geometry::Mesh { file, .. } => Some(file),
            _ => None,
        });
        let files: BTreeSet<&String> = files.collect();
        let count = files.len();
        let (mut meshes, mut lacking) = (Self::default(), Vec::new());
        for file in files {
            match read(robot, file) {
                Ok(scene) => drop(meshes.0.insert(file.clone(), scene)),
                Err(reason) => lacking.push(format!("{file}: {reason}")),
            }
        }
        let sentence = lacking.first().map(|first| {
            let (arm, number) = (&robot.name, lacking.len());
            format!("{arm}: {number} of {count} meshes cannot be read, so simpler shapes are drawn; {first}")
        });
        (meshes, sentence)
    }

    /// Whether a form can be drawn.
    pub(crate) fn has(&self, geometry: &Geometry) -> bool {
        match geometry {
            Geometry::Mesh { file, .. } => self.0.contains_key(file),
            _ => true,
        }
    }

    /// The triangles of a file, whose lengths `scale` makes metres, with the colours of its materials.
    pub(crate) fn of_file(
        &self,
        file: &str,
        scale: Vec3,
    ) -> impl Iterator<Item = (Mesh, Option<[f32; 4]>)> {
        let scene = self.0.get(file).into_iter();
        let parts = scene.flat_map(|scene| scene.meshes.iter().zip(&scene.materials));
        parts.map(move |(part, material)| (triangles(part, scale), material.color.diffuse))
    }
}

/// The corners of a face, with their places in the part, and its normal; `None` where it has no area, or a corner that is not there.
fn triangle(
    part: &mesh_loader::Mesh,
    face: [u32; 3],
    scale: Vec3,
) -> Option<([(usize, Vec3); 3], Vec3)> {
    let [a, mut b, mut c] = face.map(|corner| corner as usize);
    if scale.element_product() < 0.0 {
        (b, c) = (c, b);
    }
    let place = |corner: usize| Some(Vec3::from(*part.vertices.get(corner)?) * scale);
    let (p, q, r) = (place(a)?, place(b)?, place(c)?);
    let flat = (q - p).cross(r - p).try_normalize()?;
    Some(([(a, p), (b, q), (c, r)], flat))
}

/// Normals turn with the scene's nodes only where they fit their face.
fn triangles(part: &mesh_loader::Mesh, scale: Vec3) -> Mesh {
    let mut mesh = Mesh::default();
    let drawn = part
        .faces
        .iter()
        .filter_map(|face| triangle(part, *face, scale));
    for (corners, flat) in drawn {
        for (corner, p) in corners {
            let own = part.normals.get(corner).map(|n| Vec3::from(*n) / scale);
            let own = own
                .map(Vec3::normalize_or_zero)
                .filter(|n| n.dot(flat) > 0.7);
            mesh.positions.push(p);
            mesh.normals.push(own.unwrap_or(flat));
        }
    }
    mesh
}

/// COLLADA's `up_axis` is left out, as by RViz and FCL: the coordinates in the file are those of the link.
fn read(robot: &Robot, file: &str) -> Result<Scene, String> {
    let path = find(&robot.meshes, file).ok_or_else(|| match file.split_once("://") {
        Some(_) => "it is in no folder above the robot's file: add its package to ROS_PACKAGE_PATH",
        None => "there is no such file in the folder of the robot's file",
    })?;
    let bytes = files::read(&path).map_err(|error| error.to_string())?;
    let ending = path.extension().unwrap_or_default();
    if ending.eq_ignore_ascii_case("dae") {
        check_collada(&bytes)?;
    } else if ending.eq_ignore_ascii_case("stl") {
        check_stl(&bytes)?;
    }
    let loader = Loader::default().custom_reader(files::read);
    match guarded(|| loader.load_from_slice(&bytes, &path)) {
        Ok(Ok(scene)) if scene.meshes.iter().any(has_area) => Ok(scene),
        Ok(Err(error)) => Err(error.to_string()),
        _ => Err("it is no STL, OBJ or COLLADA file with triangles".to_owned()),
    }
}

/// Whether a part has a triangle that can be drawn.
fn has_area(part: &mesh_loader::Mesh) -> bool {
    let mut faces = part.faces.iter();
    faces.any(|face| triangle(part, *face, Vec3::ONE).is_some())
}

/// Refuses a binary STL that has been cut off: 80 bytes, the number of triangles, and 50 bytes for each.
fn check_stl(bytes: &[u8]) -> Result<(), String> {
    let claimed = bytes.get(80..84).and_then(|count| count.try_into().ok());
    let claimed = claimed.map_or(0, u32::from_le_bytes);
    let has = bytes.len().saturating_sub(84) / 50;
    if !bytes.starts_with(b"solid") && has < claimed as usize {
        return Err(format!("it claims {claimed} triangles and has {has}"));
    }
    Ok(())
}

/// Elements inside one another that a mesh needs at most: the parser takes stack for each.
const DEEPEST: usize = 64;

/// Refuses what ends the parser, or keeps it for ever: elements too deep, arrays that claim more numbers than the file has bytes for, lists of names.
fn check_collada(bytes: &[u8]) -> Result<(), String> {
    let mut reader = Reader::from_reader(bytes);
    let (mut depth, mut is_vcount) = (0_usize, false);
    let (mut numbers, mut width) = (0_u64, 1_u64);
    loop {
        let event = reader.read_event().map_err(|error| error.to_string())?;
        match &event {
            Event::Eof => return Ok(()),
            Event::Start(_) => depth += 1,
            Event::End(_) => depth = depth.saturating_sub(1),
            Event::Text(text) if is_vcount => {
                let corners = std::str::from_utf8(text)
                    .unwrap_or_default()
                    .split_whitespace()
                    .map(number);
                numbers = numbers.max(corners.fold(0, u64::saturating_add));
            }
            _ => {}
        }
        if let Event::Start(tag) | Event::Empty(tag) = &event {
            is_vcount = tag.name().0 == b"vcount";
            if [b"Name_array".as_slice(), b"IDREF_array"].contains(&tag.name().0) {
                return Err(
                    "it has lists of names, as of a skeleton: export the mesh alone".to_owned(),
                );
            }
            for attribute in tag.attributes().flatten() {
                let value = || number(&String::from_utf8_lossy(&attribute.value));
                match attribute.key.0 {
                    b"count" => numbers = numbers.max(value()),
                    b"offset" => width = width.max(value().saturating_add(1)),
                    _ => {}
                }
            }
        }
        if depth > DEEPEST {
            return Err(format!(
                "it has more than {DEEPEST} elements inside one another"
            ));
        }
        if numbers.saturating_mul(width) > 4 * bytes.len() as u64 {
            return Err("it claims more numbers than it has".to_owned());
        }
    }
}

/// A count in a file; one that is none is larger than any.
fn number(text: &str) -> u64 {
    text.trim().parse().unwrap_or(u64::MAX)
}

/// Does work that panics on damaged bytes, without the words of its panic.
fn guarded<T>(work: impl FnOnce() -> T) -> std::thread::Result<T> {
    let usual = take_hook();
    set_hook(Box::new(|_| ()));
    let done = catch_unwind(AssertUnwindSafe(work));
    set_hook(usual);
    done
}

/// The file that a path from a folder, or a URL, names: a package is a folder of its name above the robot's file, beside one of those, or where ROS has it.
fn find(folder: &Path, file: &str) -> Option<PathBuf> {
    let Some((scheme, rest)) = file.split_once("://") else {
        return Some(folder.join(file)).filter(|path| path.is_absolute() && path.is_file());
    };
    if scheme == "file" {
        return Some(PathBuf::from(rest)).filter(|path| path.is_file());
    }
    let (package, rest) = rest.split_once('/')?;
    let mut homes: Vec<PathBuf> = folder.ancestors().map(Path::to_owned).collect();
    for (variable, inside) in PACKAGES {
        let listed = var_os(variable).unwrap_or_default();
        homes.extend(split_paths(&listed).map(|home| home.join(inside)));
    }
    let mut all = homes.iter().flat_map(|home| {
        home.ends_with(package)
            .then(|| home.join(rest))
            .into_iter()
            .chain([home.join(package).join(rest)])
    });
    all.find(|file| file.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Body, Form};
    use std::fs::{create_dir_all, write};

    const STL: &str = "solid t
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 1000 0 0
vertex 0 1000 0
endloop
endfacet
endsolid t
";
    const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    const DAE: &str = r##"<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="0.001"/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="9">0 0 0 1000 0 0 0 1000 0</float_array>
<technique_common><accessor source="#a" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"##;
    const INERTIAL: &str = r#"<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#;

    fn urdf(mesh: &str) -> String {
        format!(
            r#"<robot name="r"><link name="base"/><link name="a">{INERTIAL}<visual><origin xyz="0 0 1" rpy="0 0 1.5707963"/>
<geometry><mesh {mesh}/></geometry><material name="m"><color rgba="1 0 0 1"/></material></visual>
<collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="j" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit effort="1" velocity="1"/></joint></robot>"#
        )
    }

    /// Corners of the mesh of the only link, none where another form stands in, its colour, and the sentence about what is lacking.
    fn drawn(path: &Path, text: &str) -> (Vec<Vec3>, u32, Option<String>) {
        write(path, text).expect("room");
        let source = files::robot(path, None).expect("there");
        let robot = Robot::from_source(&source).expect("an arm");
        let (meshes, lacking) = Meshes::of(&robot);
        let part = Body::new(&robot, 0.0, &meshes)
            .parts
            .into_iter()
            .find(|part| part.link == Some(0))
            .expect("a link");
        let corners = match part.form {
            Form::Mesh(mesh) => mesh
                .positions
                .iter()
                .map(|p| part.at.transform_point3(*p))
                .collect(),
            _ => Vec::new(),
        };
        (corners, part.colour, lacking)
    }

    #[test]
    fn meshes_are_found_scaled_placed_and_coloured_and_the_sphere_stands_in_for_those_that_are_lacking()
     {
        let folder = tempfile::tempdir().expect("room");
        let package = folder.path().join("my_arm");
        let (texts, meshes) = (package.join("urdf"), package.join("meshes"));
        create_dir_all(&texts).expect("room");
        create_dir_all(&meshes).expect("room");
        for (name, text) in [
            ("a.stl", STL),
            ("a.obj", OBJ),
            ("a.dae", DAE),
            ("b.stl", "solid"),
        ] {
            write(meshes.join(name), text).expect("room");
        }
        let placed = [Vec3::Z, Vec3::new(0.0, 1.0, 1.0), Vec3::new(-1.0, 0.0, 1.0)];
        for (mesh, is_read) in [
            (
                r#"filename="../meshes/a.stl" scale="0.001 0.001 0.001""#,
                true,
            ),
            (r#"filename="package://my_arm/meshes/a.obj""#, true),
            (r#"filename="package://my_arm/meshes/a.dae""#, true),
            (r#"filename="package://my_arm/meshes/b.stl""#, false),
            (r#"filename="package://other/meshes/a.stl""#, false),
            (r#"filename="none.stl""#, false),
        ] {
            let (corners, colour, lacking) = drawn(&texts.join("arm.urdf"), &urdf(mesh));
            assert_eq!(lacking.is_none(), is_read, "{mesh}: {lacking:?}");
            let near = |(a, b): (&Vec3, &Vec3)| a.distance(*b) < 1e-5;
            assert!(corners.iter().zip(&placed).all(near), "{mesh}: {corners:?}");
            assert_eq!(corners.len(), if is_read { 3 } else { 0 }, "{mesh}");
            assert_eq!(colour == 0xff0000ff, is_read, "{mesh}");
        }
    }

    #[test]
    fn a_stl_that_is_cut_off_or_shows_nothing_is_lacking() {
        let folder = tempfile::tempdir().unwrap();
        let stl = |claimed: u32, height: f32| {
            let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, height, 0.0];
            let numbers = [0.0; 3].into_iter().chain(corners);
            let triangle = numbers.flat_map(f32::to_le_bytes).chain([0, 0]);
            let head = [0; 80].into_iter().chain(claimed.to_le_bytes());
            head.chain(triangle).collect::<Vec<u8>>()
        };
        for (claimed, height, is_read) in [
            (1, 1.0, true),
            (u32::MAX, 1.0, false),
            (1, 0.0, false),
            (1, f32::NAN, false),
        ] {
            std::fs::write(folder.path().join("a.stl"), stl(claimed, height)).unwrap();
            let mesh = r#"filename="a.stl""#;
            let (corners, _, lacking) = drawn(&folder.path().join("arm.urdf"), &urdf(mesh));
            assert_eq!(
                lacking.is_none(),
                is_read,
                "{claimed} {height}: {lacking:?}"
            );
            assert_eq!(corners.len(), if is_read { 3 } else { 0 });
        }
    }

    #[test]
    fn a_mesh_that_would_end_or_hold_up_its_parser_is_refused() {
        let nested = "<node>".repeat(20_000) + &"</node>".repeat(20_000);
        let node = r#"<node id="n">"#;
        assert!(check_collada(DAE.as_bytes()).is_ok());
        for (own, hostile) in [
            (r#"count="9""#, r#"count="4294967295""#),
            (r#"<triangles count="1">"#, r#"<triangles count="-1">"#),
            (r#"offset="0""#, r#"offset="4000000000""#),
            ("<p>", "<vcount>4000000000 1</vcount><p>"),
            (node, &format!("{nested}{node}")),
            ("<mesh>", r#"<mesh><Name_array count="1">a</Name_array>"#),
        ] {
            let text = DAE.replacen(own, hostile, 1);
            assert_ne!(text, DAE);
            assert!(check_collada(text.as_bytes()).is_err(), "{hostile:.60}");
        }
    }
}
