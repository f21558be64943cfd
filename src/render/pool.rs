//! Phase 2 of Algorithm 1: the light-vertex pool of an iteration. The host collects the vertices that the device traced and
//! sorts them for the estimator.

use bytemuck::Zeroable;
use rayon::prelude::*;

use super::photons::{NO_LEVELS, PhotonMap};
use super::plan::Plan;
use super::pool_layout::PoolLayout;
use super::selection_cdf::set_selection_cdf;
use super::stats::{Stats, stage};
use crate::error::{Error, Result};
use crate::estimators::PoolOrder;
use crate::gpu::{Allocate, Buffer, BufferDesc, BufferList, Device};
use crate::lightcone::tree::{Item, Tree, TreeOptions, bounds};
use crate::wgsl::layout::constants::*;
use crate::wgsl::layout::{LeafRecord, NONE, PathVertex, Photon, TreeChild, TreeNode};

/// Light vertices of an iteration, by kind. [`LightPool::sort`] puts them into the order that the estimator's kernels expect.
#[derive(Default)]
pub struct LightPool {
    /// Punctual lights of the scene, and the spot of each beam of zero radius, which all subpaths of the beam share.
    deterministic: Vec<PathVertex>,
    /// Emitter points (v_tau = 0) and scattered vertices.
    emitter_points: PathVertices,
    scattered: PathVertices,
}

/// Light vertices, and the index of the light path of each.
#[derive(Default)]
struct PathVertices {
    paths: Vec<u32>,
    vertices: Vec<PathVertex>,
}

impl PathVertices {
    fn push(&mut self, path: u32, vertex: &PathVertex) {
        self.paths.push(path);
        self.vertices.push(*vertex);
    }

    fn clear(&mut self) {
        self.paths.clear();
        self.vertices.clear();
    }

    fn len(&self) -> usize {
        self.vertices.len()
    }
}

/// Maximum number of vertices in a pool: the index of a leaf's first vertex must be less than [`LEAF_FIRST`].
const MAX_VERTICES: usize = LEAF_FIRST as usize;

/// The pool on the device: group 1 of the kernels.
pub struct DevicePool<A: Allocate = Device> {
    vertices: A::Buffer,
    records: A::Buffer,
    nodes: A::Buffer,
    offsets: A::Buffer,
    photons: A::Buffer,
    photon_lists: A::Buffer,
}

/// The arrays of a pool, ready for upload.
pub struct SortedPool {
    pub vertices: Vec<PathVertex>,
    /// The leaf records of all vertices; empty if the pool has no trees.
    pub records: Vec<LeafRecord>,
    pub nodes: Vec<TreeNode>,
    pub offsets: Vec<u32>,
    /// Empty if the render does not merge.
    pub photons: PhotonMap,
    pub layout: PoolLayout,
}

impl SortedPool {
    /// Adds the photons of the iteration.
    pub fn set_photons(&mut self, photons: PhotonMap) {
        self.layout.photon_list_mask = (photons.lists.len() as u32).saturating_sub(2);
        self.layout.photon_levels = photons.levels;
        self.photons = photons;
    }
}

impl LightPool {
    /// Removes all vertices and adds these `deterministic` ones. The memory stays allocated.
    pub fn restart(&mut self, deterministic: &[PathVertex]) {
        self.deterministic.clear();
        self.deterministic.extend_from_slice(deterministic);
        self.emitter_points.clear();
        self.scattered.clear();
    }

    /// Adds a vertex of light path `path`; the path index of a deterministic vertex is ignored. Drops any other vertex that is too
    /// deep for a connected path of at most `max_depth` segments.
    pub fn push(&mut self, path: u32, vertex: &PathVertex, max_depth: u32) {
        if vertex.flags & VERTEX_DETERMINISTIC != 0 {
            self.deterministic.push(*vertex);
        } else if (vertex.flags & VERTEX_DEPTH) + 2 > max_depth {
            // A connection adds two segments, to the shade point and to the sensor. Deeper vertices serve only t = 1.
        } else if vertex.flags & VERTEX_EMITTER != 0 {
            self.emitter_points.push(path, vertex);
        } else {
            self.scattered.push(path, vertex);
        }
    }

    /// Orders the vertices for the estimator: builds the trees, groups the vertices by path, or sorts them by travel time. Fails if
    /// there are more than [`MAX_VERTICES`].
    pub fn sort(&self, plan: &Plan, stats: &mut Stats) -> Result<SortedPool> {
        let count = self.deterministic.len() + self.emitter_points.len() + self.scattered.len();
        if count > MAX_VERTICES {
            return Err(Error::settings(format!(
                "an iteration has {count} light vertices, but at most {MAX_VERTICES} are possible; use fewer --light-paths"
            )));
        }
        stats.deterministic_vertices += self.deterministic.len() as u64;
        stats.emitter_vertices += self.emitter_points.len() as u64;
        stats.scattered_vertices += self.scattered.len() as u64;
        // Trees and the order by travel time leave out vertices whose power is not finite, so the host counts these vertices. With
        // the other orders, the device counts the connections to them, which are not finite.
        if matches!(plan.estimator.pool_order, PoolOrder::Trees | PoolOrder::ByTime) {
            let vertices = self.emitter_points.vertices.iter().chain(&self.scattered.vertices);
            stats.dropped += vertices.filter(|vertex| !power(vertex).is_finite()).count() as u64;
        }
        Ok(stats.timed(stage::BUILD_TREES, || match plan.estimator.pool_order {
            PoolOrder::ByPath => self.by_path(plan.light_paths),
            PoolOrder::EmitterPoints => self.emitters_only(),
            PoolOrder::Trees => self.trees(plan),
            PoolOrder::ByTime => self.by_time(),
        }))
    }

    fn layout(&self) -> PoolLayout {
        PoolLayout {
            deterministic: self.deterministic.len() as u32,
            emitter_vertices: 0,
            tree3_root: NONE,
            tree4_root: NONE,
            longest_path: 0,
            vertices: 0,
            photon_list_mask: 0,
            photon_levels: NO_LEVELS,
        }
    }

    /// The deterministic vertices. If each shade point draws some of them, they have the CDF for it.
    fn deterministic_with_cdf(&self) -> Vec<PathVertex> {
        let mut vertices = self.deterministic.clone();
        if vertices.len() > DETERMINISTIC_SLOTS as usize {
            set_selection_cdf(&mut vertices);
        }
        vertices
    }

    fn emitters_only(&self) -> SortedPool {
        let mut vertices = self.deterministic_with_cdf();
        vertices.extend_from_slice(&self.emitter_points.vertices);
        let layout = PoolLayout { emitter_vertices: self.emitter_points.len() as u32, ..self.layout() };
        SortedPool { vertices, records: vec![], nodes: vec![], offsets: vec![], photons: PhotonMap::default(), layout }
    }

    /// Counting sort by light path. The vertices of a path stay in the order of the path.
    fn by_path(&self, light_paths: u32) -> SortedPool {
        let first = self.deterministic.len() as u32;
        let mut offsets = vec![0u32; light_paths as usize + 1];
        let paths = || self.emitter_points.paths.iter().chain(&self.scattered.paths);
        for path in paths() {
            offsets[*path as usize + 1] += 1;
        }
        let longest_path = offsets.iter().copied().max().unwrap_or(0);
        offsets[0] = first;
        for i in 1..offsets.len() {
            offsets[i] += offsets[i - 1];
        }
        // `order` holds the index of the vertex for each place after the deterministic vertices. `next` holds the next free place of
        // each path.
        let mut next = offsets.clone();
        let mut order = vec![0u32; paths().count()];
        for (i, path) in (0..).zip(paths()) {
            let place = &mut next[*path as usize];
            order[(*place - first) as usize] = i;
            *place += 1;
        }
        let [points, scattered] = [&self.emitter_points.vertices, &self.scattered.vertices];
        let vertex = |&i: &u32| points.get(i as usize).unwrap_or_else(|| &scattered[i as usize - points.len()]);
        let mut vertices = self.deterministic_with_cdf();
        vertices.par_extend(order.par_iter().map(vertex));
        SortedPool {
            vertices,
            records: vec![],
            nodes: vec![],
            offsets,
            photons: PhotonMap::default(),
            layout: PoolLayout { longest_path, ..self.layout() },
        }
    }

    /// Sorts emitter points and scattered vertices by travel time. The left child of the only node holds their bounds, and in
    /// `child` their number.
    fn by_time(&self) -> SortedPool {
        let all = [&self.emitter_points.vertices[..], &self.scattered.vertices].concat();
        let (_, mut items) = items(&all, 0);
        items.sort_unstable_by(|a, b| a.point[3].total_cmp(&b.point[3]).then(a.index.cmp(&b.index)));
        let mut vertices = self.deterministic_with_cdf();
        vertices.extend(items.iter().map(|item| all[item.index as usize]));
        let ([lo @ .., tau_lo], [hi @ .., tau_hi]) = bounds(&items);
        let child = items.len() as u32;
        let node = TreeNode {
            left: TreeChild { lo, tau_lo, hi, tau_hi, child, ..Zeroable::zeroed() },
            right: Zeroable::zeroed(),
        };
        let (nodes, tree4_root) = if items.is_empty() { (vec![], NONE) } else { (vec![node], 0) };
        SortedPool {
            vertices,
            records: vec![],
            nodes,
            offsets: vec![],
            photons: PhotonMap::default(),
            layout: PoolLayout { tree4_root, ..self.layout() },
        }
    }

    /// Builds the 3D tree over emitter points and the 4D tree over scattered vertices (Sec. 5.4), or a single 4D tree over
    /// all of them. Both are valid: a query weights the vertex that it returns, of either kind, by 1 / P of this vertex. If the
    /// deterministic vertices are too many to connect one by one, they form separate subtrees. Punctual lights are then in the 3D tree,
    /// even if there is a single 4D tree. So the lights have queries and shadow rays of their own. The spots of thin beams are in the
    /// 4D tree.
    fn trees(&self, plan: &Plan) -> SortedPool {
        let in_trees = plan.queries_deterministic(self.deterministic.len() as u32);
        let (one_by_one, queried) = self.deterministic.split_at(if in_trees { 0 } else { self.deterministic.len() });
        let (mut spatial, mut all): (Vec<_>, Vec<_>) = queried.iter().partition(|v| v.flags & VERTEX_EMITTER != 0);
        let (separate3, separate4) = (spatial.len(), all.len());
        all.extend_from_slice(&self.scattered.vertices);
        let emitter_points = if plan.single_tree { &mut all } else { &mut spatial };
        emitter_points.extend_from_slice(&self.emitter_points.vertices);
        let (separate3, mut items3) = items(&spatial, separate3);
        let (separate4, mut items4) = items(&all, separate4);
        let first3 = one_by_one.len() as u32;
        let first4 = first3 + items3.len() as u32;
        let (leaf_size, buckets) = (plan.leaf_size as usize, plan.buckets);
        let options = TreeOptions { leaf_size, buckets, first_node: 0, first_vertex: first3 };
        let tree3 = Tree::build_with_separate_subtree(&mut items3, separate3, options);
        let first_node = tree3.nodes.len() as u32;
        let tree4 = Tree::build_with_separate_subtree(
            &mut items4,
            separate4,
            TreeOptions { first_node, first_vertex: first4, ..options },
        );
        let mut vertices = one_by_one.to_vec();
        vertices.extend(items3.iter().map(|i| spatial[i.index as usize]));
        vertices.extend(items4.iter().map(|i| all[i.index as usize]));
        let layout = PoolLayout {
            deterministic: one_by_one.len() as u32,
            emitter_vertices: items3.len() as u32,
            tree3_root: tree3.root,
            tree4_root: tree4.root,
            vertices: vertices.len() as u32,
            ..self.layout()
        };
        SortedPool {
            records: vertices.par_iter().map(leaf_record).collect(),
            vertices,
            nodes: [tree3.nodes, tree4.nodes].concat(),
            offsets: vec![],
            photons: PhotonMap::default(),
            layout,
        }
    }
}

/// The largest channel of the throughput.
fn power(v: &PathVertex) -> f32 {
    v.throughput.iter().fold(0.0f32, |a, &x| a.max(x))
}

/// Tree items of the vertices with a positive and finite power, and the number of these items among the first `separate`
/// vertices.
fn items(vertices: &[PathVertex], separate: usize) -> (usize, Vec<Item>) {
    let items: Vec<Item> = vertices
        .iter()
        .enumerate()
        .filter(|(_, v)| power(v) > 0.0 && power(v).is_finite())
        .map(|(i, v)| Item {
            point: [v.position[0], v.position[1], v.position[2], v.tau],
            power: power(v),
            index: i as u32,
        })
        .collect();
    (items.partition_point(|item| (item.index as usize) < separate), items)
}

/// The part of `v` that a query reads to choose a vertex in a leaf.
pub fn leaf_record(v: &PathVertex) -> LeafRecord {
    let direction = if v.flags & VERTEX_IN_MEDIUM != 0 { v.to_previous } else { v.geometric };
    LeafRecord {
        position: v.position,
        tau: v.tau,
        power: power(v),
        direction: pack_direction(direction),
        flags: v.flags,
        material: v.material,
    }
}

/// Packs a unit vector as three signed fractions of 10 bits, x lowest.
fn pack_direction(v: [f32; 3]) -> u32 {
    let bits = v.map(|x| (x.clamp(-1.0, 1.0) * 511.0).round() as i32 as u32 & 0x3ff);
    bits[0] | bits[1] << 10 | bits[2] << 20
}

/// Number of entries of the arrays of a pool.
#[derive(Clone, Copy)]
pub struct PoolSize {
    pub vertices: usize,
    pub records: usize,
    pub nodes: usize,
    pub offsets: usize,
    pub photons: usize,
    pub photon_lists: usize,
}

impl<A: Allocate> DevicePool<A> {
    fn allocate(to: &A, size: PoolSize) -> Result<DevicePool<A>> {
        let PoolSize { vertices, records, nodes, offsets, photons, photon_lists } = size;
        let remedy = "use fewer --light-paths";
        let fewer = "use a smaller --resolution, or --merge off";
        let room = |n: usize| n + n / 8 + 64;
        Ok(DevicePool {
            vertices: to.buffer(BufferDesc::of_texels::<PathVertex>("light vertices", room(vertices), remedy))?,
            records: to.buffer(BufferDesc::of_texels::<LeafRecord>("leaf records", room(records), remedy))?,
            nodes: to.buffer(BufferDesc::of_texels::<TreeNode>("tree nodes", room(nodes), remedy))?,
            offsets: to.buffer(BufferDesc::of::<u32>("light path offsets", offsets, remedy))?,
            photons: to.buffer(BufferDesc::of_texels::<Photon>("photons", photons, fewer))?,
            photon_lists: to.buffer(BufferDesc::of::<u32>("lists of photons", photon_lists, fewer))?,
        })
    }
}

impl DevicePool {
    /// Uploads `pool` into new buffers with some extra room, because the size of the pool varies from iteration to iteration.
    pub fn new(device: &Device, pool: &SortedPool) -> Result<DevicePool> {
        let room = |n: usize| n + n / 8;
        let mut buffers = DevicePool::allocate(
            device,
            PoolSize {
                vertices: pool.vertices.len(),
                records: pool.records.len(),
                nodes: pool.nodes.len(),
                offsets: pool.offsets.len(),
                photons: room(pool.photons.photons.len()).max(1),
                photon_lists: pool.photons.lists.len().max(1),
            },
        )?;
        buffers.replace(pool)?;
        Ok(buffers)
    }

    /// Descriptors of the buffers for a pool of this size, extra room included.
    pub fn buffer_descs(size: PoolSize) -> Vec<BufferDesc> {
        BufferList::of(|list| DevicePool::allocate(list, size))
    }

    /// Overwrites the buffers with `pool`. Returns false, and writes nothing, if `pool` does not fit.
    pub fn replace(&mut self, pool: &SortedPool) -> Result<bool> {
        let fits = |buffer: &Buffer, bytes: usize| buffer.size() >= bytes as u64;
        if !fits(&self.vertices, size_of_val(&pool.vertices[..]))
            || !fits(&self.records, size_of_val(&pool.records[..]))
            || !fits(&self.nodes, size_of_val(&pool.nodes[..]))
            || !fits(&self.offsets, size_of_val(&pool.offsets[..]))
            || !fits(&self.photons, size_of_val(&pool.photons.photons[..]))
            || !fits(&self.photon_lists, size_of_val(&pool.photons.lists[..]))
        {
            return Ok(false);
        }
        self.vertices.write(0, &pool.vertices)?;
        self.records.write(0, &pool.records)?;
        self.nodes.write(0, &pool.nodes)?;
        self.offsets.write(0, &pool.offsets)?;
        self.photons.write(0, &pool.photons.photons)?;
        self.photon_lists.write(0, &pool.photons.lists)?;
        Ok(true)
    }

    pub fn bindings(&self) -> Vec<(&str, &Buffer)> {
        vec![
            ("light_vertices", &self.vertices),
            ("leaf_records", &self.records),
            ("tree_nodes", &self.nodes),
            ("path_offsets", &self.offsets),
            ("photons", &self.photons),
            ("photon_lists", &self.photon_lists),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimators::Estimator;
    use crate::generate::{Kind, build};
    use crate::gpu::Quirks;
    use crate::render::PreparedScene;
    use crate::settings::Settings;

    #[test]
    fn vertices_that_the_trees_leave_out_are_counted() {
        let scene = build(Kind::CornellBox);
        for (estimator, dropped) in [(Estimator::Lcs, 1), (Estimator::Bdpt, 0)] {
            let settings = Settings::builder().estimator(estimator).light_paths(2).build().unwrap();
            let prepared = PreparedScene::new(&scene, &settings).unwrap();
            let plan = Plan::new(&scene, &settings, &prepared, Quirks::NONE).unwrap();
            let mut pool = LightPool::default();
            for power in [1.0, f32::INFINITY] {
                pool.push(0, &PathVertex { throughput: [power; 3], ..Zeroable::zeroed() }, 8);
            }
            let mut stats = Stats::default();
            let sorted = pool.sort(&plan, &mut stats).unwrap();
            assert_eq!((stats.dropped, sorted.vertices.len() as u64), (dropped, 2 - dropped), "{estimator}");
        }
    }
}
