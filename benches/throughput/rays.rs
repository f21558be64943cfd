//! Closest hits and shadow rays: the traversal kernel compared with obvhs.

use std::path::Path;

use glam::{Vec3, Vec3A};
use obvhs::ray::{Ray, RayHit};
use rayon::prelude::*;
use taugate::internals::bvh::{self, Bvh};
use taugate::internals::generate::numbers::Pcg;
use taugate::internals::gpu::{Bindings, Buffer, Device, Kernel, Recorder};
use taugate::internals::wgsl::layout::{Dispatch, NONE, Triangle};

use super::{Sizes, flatten};

const KERNEL: &str = "
#import traverse
struct BenchRay { origin: vec3<f32>, t_max: f32, direction: vec3<f32>, pad: f32 }
@group(2) @binding(0) var<storage, read> rays: array<BenchRay>;
@group(2) @binding(1) var<storage, read_write> hits: array<vec2<f32>>;
override ANY: bool = false;
@compute @workgroup_size(WORKGROUP)
fn bench_rays(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= dispatch.count) {
        return;
    }
    let ray = rays[id.x];
    let hit = traverse(ray.origin, ray.direction, LastHit(0.0, NONE), ray.t_max, ANY, NONE);
    hits[id.x] = vec2<f32>(hit.t, bitcast<f32>(hit.triangle));
}
";

/// The triangles of the cluttered room, in coordinates with the camera at the origin.
pub struct Room {
    pub bvh: Bvh,
    pub triangles: Vec<Triangle>,
    pub light: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
}

/// A ray, in the layout of the kernel's struct.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct BenchRay {
    pub origin: [f32; 3],
    pub t_max: f32,
    pub direction: [f32; 3],
    pub pad: f32,
}

fn ray(origin: Vec3, direction: Vec3, t_max: f32) -> BenchRay {
    BenchRay { origin: origin.into(), t_max, direction: direction.into(), pad: 0.0 }
}

impl Room {
    pub fn new(triangles: u32) -> Room {
        let (corners, camera) = flatten::cluttered_room(triangles);
        let bvh = bvh::build(&corners);
        let triangle = |&i: &u32| {
            let [v0, v1, v2] = corners[i as usize];
            Triangle { v0, instance: 0, v1, corner: NONE, v2, material: 0 }
        };
        let axis = |v: glam::DVec3| camera.transform_vector3(v).as_vec3();
        Room {
            triangles: bvh.order.iter().map(triangle).collect(),
            bvh,
            light: axis(glam::DVec3::new(0.0, 0.4, -1.5)),
            right: axis(glam::DVec3::X),
            up: axis(glam::DVec3::Y),
            forward: axis(glam::DVec3::NEG_Z),
        }
    }

    /// Index of the closest triangle and its distance; `None` if the ray hits nothing.
    pub fn closest(&self, r: &BenchRay) -> Option<(usize, f32)> {
        let mut hit = RayHit::none();
        self.bvh.host.ray_traverse(host_ray(r), &mut hit, |ray, i| self.intersect(ray, i));
        (hit.t < r.t_max).then_some((hit.primitive_id as usize, hit.t))
    }

    fn blocked(&self, r: &BenchRay) -> bool {
        !self.bvh.host.ray_traverse_miss(host_ray(r), |ray, i| self.intersect(ray, i))
    }

    /// Distance to triangle `i` in leaf order by the test of Moeller and Trumbore; infinite without a hit.
    fn intersect(&self, ray: &Ray, i: usize) -> f32 {
        let t = &self.triangles[i];
        let v0 = Vec3A::from(t.v0);
        let (e1, e2) = (Vec3A::from(t.v1) - v0, Vec3A::from(t.v2) - v0);
        let p = ray.direction.cross(e2);
        let inverse = 1.0 / e1.dot(p);
        let s = ray.origin - v0;
        let u = s.dot(p) * inverse;
        let q = s.cross(e1);
        let v = ray.direction.dot(q) * inverse;
        let d = e2.dot(q) * inverse;
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && d > ray.tmin && d < ray.tmax { d } else { f32::INFINITY }
    }

    pub fn normal(&self, i: usize, towards: Vec3) -> Vec3 {
        let t = &self.triangles[i];
        let n = (Vec3::from(t.v1) - Vec3::from(t.v0)).cross(Vec3::from(t.v2) - Vec3::from(t.v0)).normalize();
        if n.dot(towards) < 0.0 { -n } else { n }
    }

    /// Hit point of a ray, moved off the surface by 1e-4, and the normal there; `None` if the ray hits nothing.
    pub fn land(&self, r: &BenchRay) -> Option<(Vec3, Vec3)> {
        let (i, t) = self.closest(r)?;
        let n = self.normal(i, -Vec3::from(r.direction));
        Some((Vec3::from(r.origin) + Vec3::from(r.direction) * t + n * 1e-4, n))
    }

    pub fn primary(&self, x: f32, y: f32) -> BenchRay {
        ray(Vec3::ZERO, (self.forward + 0.7 * x * self.right + 0.4 * y * self.up).normalize(), 1e30)
    }
}

fn host_ray(r: &BenchRay) -> Ray {
    Ray::new(Vec3A::from(r.origin), Vec3A::from(r.direction), 0.0, r.t_max)
}

/// Cosine-distributed direction around `n`.
pub fn cosine(n: Vec3, pcg: &mut Pcg) -> Vec3 {
    let z = 2.0 * pcg.uniform() - 1.0;
    let (sin, cos) = (std::f64::consts::TAU * pcg.uniform()).sin_cos();
    let r = (1.0 - z * z).sqrt();
    (n + Vec3::new((r * cos) as f32, (r * sin) as f32, z as f32) * 0.999).normalize()
}

/// Rays of one kind. `any`: any hit is enough, otherwise the closest hit is found.
struct Batch {
    name: &'static str,
    rays: Vec<BenchRay>,
    any: bool,
}

/// Camera rays of an image of `side` x `side` pixels, in blocks of 8 x 8 pixels as the renderer traces them; one diffuse bounce;
/// and a shadow ray at each hit.
fn mixed_rays(room: &Room, side: usize) -> [Batch; 4] {
    let mut pcg = Pcg::new(11);
    let mut batches = [("primary", false), ("shadow of primary", true), ("bounce", false), ("shadow of bounce", true)]
        .map(|(name, any)| Batch { name, rays: vec![], any });
    for i in 0..side * side {
        let (block, k) = (i / 64, i % 64);
        let (bx, by) = (block % (side / 8), block / (side / 8));
        let at = |b: usize, k: usize| ((b * 8 + k) as f32 + 0.5) / side as f32 * 2.0 - 1.0;
        let mut r = room.primary(at(bx, k % 8), -at(by, k / 8));
        for bounce in 0..2 {
            batches[2 * bounce].rays.push(r);
            let Some((p, n)) = room.land(&r) else { break };
            batches[2 * bounce + 1].rays.push(ray(p, room.light - p, 1.0));
            r = ray(p, cosine(n, &mut pcg), 1e30);
        }
    }
    batches
}

/// A batch in buffers of the device, with its kernel.
struct Uploaded {
    kernel: Kernel,
    bound: Bindings,
    count: usize,
    hits: Buffer,
    _rays: Buffer,
}

impl Uploaded {
    fn new(device: &Device, nodes: &Buffer, triangles: &Buffer, batch: &Batch) -> Uploaded {
        let any = f64::from(u8::from(batch.any));
        let kernel = Kernel::from_source(device, "bench", KERNEL, "bench_rays", &[("ANY", any)]).expect("kernel");
        let rays = Buffer::from_slice(device, "rays", &batch.rays, "").expect("rays");
        let hits = Buffer::new::<[f32; 2]>(device, "hits", batch.rays.len(), "").expect("hits");
        let buffers = [("bvh_nodes", nodes), ("triangles", triangles), ("rays", &rays), ("hits", &hits)];
        let bound = kernel.bind(&buffers).expect("binding");
        Uploaded { kernel, bound, count: batch.rays.len(), hits, _rays: rays }
    }

    fn trace(&self, recorder: &mut Recorder) {
        let d = Dispatch { count: self.count as u32, ..bytemuck::Zeroable::zeroed() };
        recorder.dispatch("rays", &self.kernel, &self.bound, &d, self.kernel.groups(self.count)).expect("dispatch");
    }
}

/// Number of closest hits on the device that differ from the hits on the host.
fn differing(room: &Room, batch: &Batch, uploaded: &Uploaded) -> usize {
    let hits = uploaded.hits.to_vec::<[f32; 2]>(batch.rays.len()).expect("hits");
    let differs = |(r, h): &(&BenchRay, &[f32; 2])| match room.closest(r) {
        Some((_, t)) => h[1].to_bits() == NONE || (t - h[0]).abs() > 1e-3 * t,
        None => h[1].to_bits() != NONE,
    };
    batch.rays.par_iter().zip(&hits).filter(differs).count()
}

fn on_host(room: &Room, batch: &Batch) {
    let rays = batch.rays.par_iter().with_min_len(256);
    let hit = if batch.any {
        rays.filter(|r| room.blocked(r)).count()
    } else {
        rays.filter(|r| room.closest(r).is_some()).count()
    };
    assert!(hit > 0);
}

/// Writes the corners of the triangles and then the batches, so that another program can trace the same rays. All values are
/// 32-bit words; each array starts with its number of elements.
fn write(file: &Path, room: &Room, batches: &[Batch]) {
    let corners: Vec<[[f32; 3]; 3]> = room.triangles.iter().map(|t| [t.v0, t.v1, t.v2]).collect();
    let mut bytes = (corners.len() as u32).to_ne_bytes().to_vec();
    bytes.extend(bytemuck::cast_slice::<_, u8>(&corners));
    for batch in batches {
        bytes.extend((batch.rays.len() as u32).to_ne_bytes());
        bytes.extend(bytemuck::cast_slice::<_, u8>(&batch.rays));
    }
    std::fs::write(file, bytes).expect("the file of rays can be written");
}

/// Prints the throughput of each kind of ray. `file`: where to write the triangles and rays.
pub fn compare(device: &Device, room: &Room, file: Option<&Path>, sizes: Sizes) {
    let batches = mixed_rays(room, sizes.side);
    if let Some(file) = file {
        write(file, room, &batches);
    }
    let nodes = Buffer::from_slice(device, "nodes", &room.bvh.nodes, "").expect("nodes");
    let triangles = Buffer::from_slice(device, "triangles", &room.triangles, "").expect("triangles");
    let uploaded = batches.each_ref().map(|b| Uploaded::new(device, &nodes, &triangles, b));
    let mut recorder = Recorder::new(device).expect("recorder");
    let mut run = |which: &[Uploaded]| {
        which.iter().for_each(|u| u.trace(&mut recorder));
        recorder.submit().expect("submit");
    };
    run(&uploaded);
    let wrong: usize = [0, 2].map(|i| differing(room, &batches[i], &uploaded[i])).iter().sum();
    println!("rays      {} primary rays; {wrong} closest hits differ between device and host", batches[0].rays.len());
    assert!(1000 * wrong <= batches[0].rays.len(), "more than 0.1 % of the closest hits differ");
    let total = batches.iter().map(|b| b.rays.len()).sum();
    super::report(
        "mixed rays",
        total,
        sizes.rounds,
        || run(&uploaded),
        || batches.iter().for_each(|b| on_host(room, b)),
    );
    for (batch, one) in batches.iter().zip(&uploaded) {
        super::report(batch.name, one.count, sizes.rounds, || run(std::slice::from_ref(one)), || on_host(room, batch));
    }
}
