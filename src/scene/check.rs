//! The properties that every scene must have, whether it was read from a file or built from arrays.

#![warn(missing_docs)]

use std::path::PathBuf;

use glam::{DAffine3, DVec3, Vec3};

use super::lens::Lens;
use super::light::Light;
use super::{Camera, Image, Instance, Material, Mesh, Scene};
use crate::error::{Error, Result};

/// Upper bound on the coordinates of a scene, in metres from the origin of the world. Within it, squares of lengths do not
/// overflow in the device's f32 numbers.
pub const MAX_COORDINATE: f64 = 1e15;
/// Upper bound on the coordinates of a principal point, in widths and heights of the image. A larger value usually means
/// that the coordinates are in pixels.
const MAX_PRINCIPAL_POINT: f64 = 10.0;
/// Widths of a pixel over its height.
const PIXEL_ASPECTS: std::ops::RangeInclusive<f64> = 0.01..=100.0;
/// Tolerance for the length of unit vectors.
const UNIT: f64 = 1e-3;

/// The error is one sentence that says what is wrong.
pub(crate) type Checked<T = ()> = std::result::Result<T, String>;

impl Scene {
    /// Checks the properties that the renderer relies on: indices are in range, numbers are finite and in their range, directions
    /// have unit length, transforms can be inverted. A scene from [`super::gltf::load`] has already passed this check.
    pub fn check(&self) -> Result<()> {
        self.checked().map_err(in_the_scene)
    }

    /// As [`Scene::check`], for the lights alone.
    pub(crate) fn check_lights(&self) -> Result<()> {
        self.lights.iter().try_for_each(Light::check).map_err(Error::settings)
    }

    pub(super) fn checked(&self) -> Checked {
        self.images.iter().enumerate().try_for_each(|(i, image)| check_image(i, image))?;
        for (i, texture) in self.textures.iter().enumerate() {
            below(texture.image, self.images.len(), || format!("texture {i}"), "image")?;
            if !texture.transform.is_finite() {
                return Err(format!("the transform of texture {i} is not finite"));
            }
        }
        self.materials.iter().try_for_each(|material| material.check(self.textures.len()))?;
        self.meshes.iter().try_for_each(|mesh| check_mesh(mesh, &self.materials))?;
        let bounds: Vec<[DVec3; 2]> = self.meshes.iter().map(Mesh::bounds).collect();
        self.instances.iter().try_for_each(|instance| check_instance(instance, &bounds))?;
        self.cameras.iter().try_for_each(check_camera)?;
        self.lights.iter().try_for_each(Light::check)?;
        let mut media = self.media.iter().enumerate();
        media.try_for_each(|(i, medium)| medium.check(&format!("medium {i}")))?;
        let skies: Vec<&Light> = self.lights.iter().filter(|light| light.kind.is_sky()).collect();
        if skies.len() > 1 {
            return Err(format!("the scene has {} skies, but only one is possible", skies.len()));
        }
        let strength = skies.first().map_or(1.0, |light| light.kind.strength().into_iter().fold(0.0, f32::max));
        self.sky.iter().try_for_each(|sky| sky.check(strength))
    }
}

impl Camera {
    /// As [`Scene::check`], for a camera alone.
    pub(crate) fn check(&self) -> Result<()> {
        check_camera(self).map_err(Error::settings)
    }
}

/// The error for a scene that was built from arrays.
pub(super) fn in_the_scene(message: String) -> Error {
    Error::Scene { path: PathBuf::from("the scene"), message }
}

/// An error if `index` is not below `count`. `of` names the object that has the index. `what` is the kind of object that
/// the index selects.
pub(super) fn below(index: u32, count: usize, of: impl Fn() -> String, what: &str) -> Checked {
    match (index as usize) < count {
        true => Ok(()),
        false => Err(format!("{} refers to {what} {index}, but the scene has {count}", of())),
    }
}

fn check_image(index: usize, image: &Image) -> Checked {
    let Image { width, height, rgba } = image;
    match u64::from(*width) * u64::from(*height) {
        0 => Err(format!("image {index} has no texels")),
        texels if texels != rgba.len() as u64 => {
            Err(format!("image {index} is {width} x {height}, but has {} texels", rgba.len()))
        }
        _ => Ok(()),
    }
}

/// Checks the arrays of a mesh, without its material.
pub(super) fn check_arrays(mesh: &Mesh) -> Checked {
    let name = || format!("mesh '{}'", mesh.name);
    let vertices = mesh.positions.len();
    if vertices == 0 {
        return Err(format!("{} has no positions", name()));
    }
    for (what, count) in [
        ("normals", mesh.normals.len()),
        ("uvs", mesh.uvs.len()),
        ("colors", mesh.colors.len()),
        ("tangents", mesh.tangents.len()),
    ] {
        if count != 0 && count != vertices {
            return Err(format!(
                "{} has {count} {what} for {vertices} positions; give one per position, or none",
                name()
            ));
        }
    }
    let numbers = mesh.positions.iter().flatten().chain(mesh.uvs.iter().flatten());
    if !numbers.copied().all(f32::is_finite) {
        return Err(format!("{} has positions or uvs that are not finite", name()));
    }
    if !mesh.normals.iter().all(|&n| is_unit(Vec3::from(n).as_dvec3())) {
        return Err(format!("{} has normals that are not of unit length", name()));
    }
    if !mesh.colors.iter().flatten().all(|x| (0.0..=1.0).contains(x)) {
        return Err(format!("{} has colors outside [0, 1]", name()));
    }
    if !mesh.tangents.iter().all(|&[x, y, z, w]| is_unit(DVec3::new(x.into(), y.into(), z.into())) && w.abs() == 1.0) {
        return Err(format!("{} has tangents that are not of unit length, or whose w is not 1 or -1", name()));
    }
    if let Some(corner) = mesh.triangles.iter().flatten().find(|&&corner| corner as usize >= vertices) {
        return Err(format!("{} has a triangle with corner {corner}, but only {vertices} positions", name()));
    }
    Ok(())
}

fn check_mesh(mesh: &Mesh, materials: &[Material]) -> Checked {
    check_arrays(mesh)?;
    let name = || format!("mesh '{}'", mesh.name);
    below(mesh.material, materials.len(), name, "material")?;
    if materials[mesh.material as usize].normal_texture.is_some() && !mesh.uvs.is_empty() && mesh.tangents.is_empty() {
        return Err(format!("{} has a normal map, but no tangents; call add_tangents", name()));
    }
    Ok(())
}

fn check_instance(instance: &Instance, meshes: &[[DVec3; 2]]) -> Checked {
    let name = || format!("node '{}'", instance.node);
    below(instance.mesh, meshes.len(), name, "mesh")?;
    if is_singular(&instance.transform) || !instance.transform.translation.is_finite() {
        return Err(format!("{} has a transform that is not finite or flattens its mesh", name()));
    }
    check_extent(&meshes[instance.mesh as usize], &instance.transform, &instance.node)
}

/// As [`Scene::check`], for a camera alone. The error is one sentence.
pub(super) fn check_camera(camera: &Camera) -> Checked {
    let name = || format!("camera '{}'", camera.name);
    let DAffine3 { matrix3, translation } = camera.transform;
    let turns = matrix3 * matrix3.transpose();
    let is_near = translation.abs().max_element() <= MAX_COORDINATE;
    if !(is_near && turns.abs_diff_eq(glam::DMat3::IDENTITY, UNIT) && matrix3.determinant() > 0.0) {
        return Err(format!(
            "{} has an invalid transform; use a rotation and a translation of at most {MAX_COORDINATE:e} m",
            name()
        ));
    }
    camera.projection.check(translation).map_err(|why| format!("{} {why}", name()))?;
    if camera.aspect.is_some_and(|aspect| !(aspect.is_finite() && aspect > 0.0)) {
        return Err(format!("{} has an aspect that is not positive", name()));
    }
    if !camera.principal_point.iter().all(|x| x.abs() <= MAX_PRINCIPAL_POINT) {
        return Err(format!(
            "{} has a principal point farther than {MAX_PRINCIPAL_POINT} image sizes from the corner; give fractions of \
             width and height",
            name()
        ));
    }
    let Lens { pixel_aspect, distortion, aperture, vignetting } = &camera.lens;
    if !(PIXEL_ASPECTS.contains(pixel_aspect) && distortion.is_finite()) {
        return Err(format!(
            "{} has a lens with pixels {pixel_aspect} times as wide as high, or a coefficient that is not finite; use finite \
             coefficients, and pixels {} to {} times as wide",
            name(),
            PIXEL_ASPECTS.start(),
            PIXEL_ASPECTS.end()
        ));
    }
    if let Some(aperture) = aperture {
        aperture.check(distortion).map_err(|why| format!("{} {why}", name()))?;
    }
    vignetting.check(distortion).map_err(|why| format!("{} {why}", name()))?;
    if camera.lens != Lens::PINHOLE && camera.projection.yfov().is_none() {
        return Err(format!(
            "{} has a lens, but only perspective cameras have one; leave the lens out, or give --fov",
            name()
        ));
    }
    match camera.resolution {
        Some([0, _] | [_, 0]) => Err(format!("{} has a resolution without pixels", name())),
        _ => Ok(()),
    }
}

/// Whether `v` has unit length, up to the rounding in files.
pub(super) fn is_unit(v: DVec3) -> bool {
    (v.length() - 1.0).abs() < UNIT
}

/// True if the matrix of the transform has no useful inverse. Such a matrix is not finite, or it (nearly) flattens space to a plane, a
/// line or a point. Thin rods and plates are allowed if their thickness is more than 1e-12 of their length.
pub fn is_singular(transform: &DAffine3) -> bool {
    let matrix = transform.matrix3;
    let longest = matrix.x_axis.length().max(matrix.y_axis.length()).max(matrix.z_axis.length());
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis * longest.recip());
    // A cube becomes a parallelepiped. Its thickness is its volume over the area of its largest face.
    let (volume, largest) =
        (x.dot(y.cross(z)).abs(), x.cross(y).length().max(y.cross(z).length()).max(z.cross(x).length()));
    volume.is_nan() || volume <= 1e-12 * largest
}

/// An error if the box of a mesh, transformed to the world, has a coordinate above [`MAX_COORDINATE`].
pub fn check_extent([low, high]: &[DVec3; 2], transform: &DAffine3, name: &str) -> Checked {
    let corners = (0..8u32).map(|corner| {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
        transform.transform_point3(DVec3::new(pick(0), pick(1), pick(2)))
    });
    for corner in corners {
        if !corner.to_array().iter().all(|value| value.abs() <= MAX_COORDINATE) {
            return Err(format!(
                "the mesh of node `{name}` reaches farther than {MAX_COORDINATE:e} m from the origin; check its scale"
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{LightKind, Medium, Projection};

    #[test]
    fn flattening_is_singular_and_thinning_is_not() {
        let scale = |x, y, z| DAffine3::from_scale(DVec3::new(x, y, z));
        assert!(is_singular(&scale(1.0, 0.0, 1.0)));
        assert!(is_singular(&scale(0.0, 0.0, 0.0)));
        assert!(is_singular(&scale(f64::NAN, 1.0, 1.0)));
        assert!(!is_singular(&scale(1.0, 1e-6, 1.0)));
        assert!(!is_singular(&scale(1e-30, -1e-30, 1e-30)));
        // A cable 1 mm thick and 1 km long, and a wall 1 nm thick and 1 km long.
        assert!(!is_singular(&scale(5e-4, 5e-4, 1e3)));
        assert!(!is_singular(&scale(1e3, 1e-9 * 1.1, 1e3)));
        assert!(is_singular(&scale(1.0, 1e-13, 1.0)));
        assert!(is_singular(&scale(1.0, 1e-13, 1e-13)));
        // No axis is short, but all lie nearly in one plane.
        let matrix3 = glam::DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.5, 0.5, 1e-13));
        assert!(is_singular(&DAffine3 { matrix3, ..DAffine3::IDENTITY }));
    }

    type Change = fn(&mut Scene);

    #[test]
    fn a_scene_that_breaks_a_rule_is_refused() {
        let scene = crate::generate::build(crate::generate::Kind::CornellBox);
        assert!(scene.check().is_ok());
        let changes: [(&str, Change); 29] = [
            ("node 'floor' refers to mesh 99, but the scene has 8", |s| s.instances[0].mesh = 99),
            ("node 'floor' has a transform", |s| s.instances[0].transform.matrix3.y_axis = DVec3::ZERO),
            ("node 'floor' has a transform", |s| s.instances[0].transform.translation.x = f64::NAN),
            ("node `floor` reaches farther", |s| s.instances[0].transform.translation.x = 1e16),
            ("mesh 'floor' refers to material 7", |s| s.meshes[0].material = 7),
            ("mesh 'floor' has no positions", |s| s.meshes[0].positions.clear()),
            ("positions or uvs that are not finite", |s| s.meshes[0].positions[3][1] = f32::INFINITY),
            ("1 normals for 4 positions", |s| s.meshes[0].normals = vec![[0.0, 1.0, 0.0]]),
            ("normals that are not of unit length", |s| s.meshes[0].normals = vec![[0.0, 2.0, 0.0]; 4]),
            ("2 colors for 4 positions", |s| s.meshes[0].colors = vec![[1.0; 4]; 2]),
            ("colors outside [0, 1]", |s| s.meshes[0].colors = vec![[0.0, 0.5, 1.5, 1.0]; 4]),
            ("tangents that are not of unit length", |s| s.meshes[0].tangents = vec![[1.0, 0.0, 0.0, 0.5]; 4]),
            ("a triangle with corner 4, but only 4 positions", |s| s.meshes[0].triangles[1][2] = 4),
            ("material 'white' has a roughness of NaN", |s| s.materials[0].roughness = f32::NAN),
            ("material 'white' has a base_color of 1.5", |s| s.materials[0].base_color[1] = 1.5),
            ("material 'white' has an emission of -1", |s| s.materials[0].emission[0] = -1.0),
            ("material 'white' refers to texture 0", |s| s.materials[0].base_color_texture = Some(0)),
            ("material 'white' has an ior of 0.5", |s| s.materials[0].ior = 0.5),
            ("image 0 is 2 x 2, but has 3 texels", |s| {
                s.images.push(Image { width: 2, height: 2, rgba: vec![[0; 4]; 3] });
            }),
            ("camera 'camera' has a yfov of 4", |s| s.cameras[0].projection = Projection::Perspective { yfov: 4.0 }),
            ("has a view 0 m high", |s| s.cameras[0].projection = Projection::Orthographic { height: 0.0 }),
            ("has a view NaN m high", |s| s.cameras[0].projection = Projection::Orthographic { height: f64::NAN }),
            ("has a view inf m high", |s| s.cameras[0].projection = Projection::Orthographic { height: f64::INFINITY }),
            ("camera 'camera' has a principal point", |s| s.cameras[0].principal_point = [0.5, 240.0]),
            ("camera 'camera' has a principal point", |s| s.cameras[0].principal_point[0] = f64::NAN),
            ("light 'lamp' has a strength", |s| {
                let intensity = [1.0, f32::NAN, 1.0];
                s.add_light("lamp", DVec3::ZERO, DVec3::X, LightKind::Point { intensity });
            }),
            ("medium 0 has a sigma_s of -1", |s| {
                s.media = vec![Medium { sigma_s: [-1.0; 3], ..Medium::default() }];
            }),
            ("the medium inside material 'white' has a sigma_a of NaN", |s| {
                let interior = Medium { sigma_a: [f64::NAN; 3], ..Medium::default() };
                s.materials[0] = Material { interior: Some(interior), ..Material::glass("white") };
            }),
            ("material 'white' has a medium inside, but a transmission of 0", |s| {
                s.materials[0].interior = Some(Medium::default());
            }),
        ];
        for (part, change) in changes {
            let mut broken = scene.clone();
            change(&mut broken);
            let message = broken.check().expect_err(part).to_string();
            assert!(message.starts_with("the scene: ") && message.contains(part), "{part}: {message}");
        }
    }
}
