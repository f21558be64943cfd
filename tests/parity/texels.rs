//! Kernels unpack structs from texel buffers. Each field must have the value that the host wrote.

use bytemuck::{Pod, Zeroable};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::render::material::Material;
use taugate::internals::wgsl::layout::{
    Emitter, InstanceNormals, PathVertex, Photon, TextureInfo, TreeChild, TreeNode, Triangle,
};

use crate::shader_function::{ShaderFunction, contents};

/// Defines a kernel that loads the struct at `input.index`.
macro_rules! loads {
    ($name:ident, $module:literal, $type:literal, $call:literal) => {
        const $name: ShaderFunction = ShaderFunction {
            imports: &[$module],
            input: "index: u32",
            result: concat!("value: ", $type),
            body: concat!("result.value = ", $call, ";"),
        };
    };
}

loads!(TRIANGLE, "scene", "Triangle", "load_triangle(input.index)");
loads!(INSTANCE, "scene", "InstanceNormals", "load_instance(input.index)");
loads!(MATERIAL, "material", "Material", "load_material(input.index)");
loads!(TEXTURE, "scene", "TextureInfo", "load_texture(input.index)");
loads!(EMITTER, "scene", "Emitter", "load_emitter(input.index)");
loads!(LIGHT_VERTEX, "tree", "PathVertex", "load_light_vertex(input.index)");
loads!(TREE_NODE, "tree", "TreeNode", "load_tree_node(input.index)");
loads!(TREE_RIGHT, "tree", "TreeChild", "load_tree_child(input.index, 1u)");
loads!(PHOTON, "photon", "Photon", "load_photon(input.index)");
loads!(SHADE_POINT, "shade_point", "PathVertex", "load_shade_point(input.index)");

pub const KERNELS: &[&ShaderFunction] = &[
    &TRIANGLE,
    &INSTANCE,
    &MATERIAL,
    &TEXTURE,
    &EMITTER,
    &LIGHT_VERTEX,
    &TREE_NODE,
    &TREE_RIGHT,
    &PHOTON,
    &SHADE_POINT,
];

const COUNT: usize = 37;

/// Returns random records, and the same records as `kernel` reads them.
fn round_trip<T: Pod>(kernel: &ShaderFunction, buffer: &'static str) -> (Vec<T>, Vec<T>) {
    let mut pcg = Pcg::new(7);
    // Finite floats only: a device may change the bits of a NaN.
    let mut word = || (pcg.uniform() * f64::from(u32::MAX)) as u32 & 0xbf7f_ffff;
    let words: Vec<u32> = (0..COUNT * size_of::<T>() / 4).map(|_| word()).collect();
    let written: Vec<T> = bytemuck::cast_slice(&words).to_vec();
    let indices: Vec<u32> = (0..COUNT as u32).rev().collect();
    // With thin glass and group indices, kernels read all texels of a material.
    let mut read: Vec<T> =
        kernel.compile(&[("HAS_SHEETS", 1.0), ("HAS_GROUP_INDICES", 1.0)]).run(&indices, &[contents(buffer, &written)]);
    read.reverse();
    (written, read)
}

#[test]
fn structs_are_read_back_as_they_were_written() {
    fn same<T: Pod + PartialEq + std::fmt::Debug>(kernel: &ShaderFunction, buffer: &'static str, clear: fn(&mut T)) {
        let (mut written, mut read) = round_trip::<T>(kernel, buffer);
        written.iter_mut().chain(&mut read).for_each(clear);
        assert_eq!(written, read, "{buffer}");
    }
    same::<Triangle>(&TRIANGLE, "triangles", |_| ());
    same::<InstanceNormals>(&INSTANCE, "instances", |i| (i.pad0, i.pad1, i.pad2) = (0.0, 0.0, 0.0));
    same::<Material>(&MATERIAL, "materials", |_| ());
    same::<TextureInfo>(&TEXTURE, "textures", |_| ());
    same::<Emitter>(&EMITTER, "emitters", |_| ());
    same::<PathVertex>(&LIGHT_VERTEX, "light_vertices", |_| ());
    same::<PathVertex>(&SHADE_POINT, "shade_points", |_| ());
    same::<Photon>(&PHOTON, "photons", |_| ());
    same::<TreeNode>(&TREE_NODE, "tree_nodes", |_| ());
}

/// The buffer holds `TreeNode` but the kernel returns `TreeChild`, so the helper above does not fit.
#[test]
fn the_second_child_of_a_tree_node() {
    let node = |k: u32| {
        let child = |n: f32| TreeChild { tau_lo: n, child: n as u32, ..Zeroable::zeroed() };
        TreeNode { left: child(k as f32), right: child(k as f32 + 0.5) }
    };
    let nodes: Vec<TreeNode> = (0..COUNT as u32).map(node).collect();
    let read: Vec<TreeChild> = TREE_RIGHT.run(&[3u32, 0, 30], &[contents("tree_nodes", &nodes)]);
    assert_eq!(read.iter().map(|c| c.tau_lo).collect::<Vec<_>>(), [3.5, 0.5, 30.5]);
}
