//! The bitstream of triangles.

use super::{take, varint};

/// The last 16 values that were pushed.
#[derive(Default)]
struct Fifo<T> {
    values: [T; 16],
    pushed: usize,
}

impl<T: Copy> Fifo<T> {
    fn push(&mut self, value: T) {
        self.values[self.pushed % 16] = value;
        self.pushed += 1;
    }

    /// The value that was pushed `back` pushes before the last one; `None` if there is none.
    fn get(&self, back: usize) -> Option<T> {
        (back < self.pushed.min(16)).then(|| self.values[(self.pushed - 1 - back) % 16])
    }
}

/// The state of the decoder of triangles.
#[derive(Default)]
struct Triangles<'a> {
    data: &'a [u8],
    next: u32,
    last: u32,
    edges: Fifo<[u32; 2]>,
    vertices: Fifo<u32>,
}

/// The `count` indices in the stream `data`; `None` if the stream is damaged.
pub fn decode(data: &[u8], count: usize) -> Option<Vec<u32>> {
    let (0xe1, body) = data.split_first()? else { return None };
    let (codes, rest) = body.split_at_checked(count / 3)?;
    let (extra, table) = rest.split_at_checked(rest.len().checked_sub(16)?)?;
    if table.iter().any(|pair| pair >> 4 == 15 || pair & 15 == 15) {
        return None;
    }
    let mut state = Triangles { data: extra, ..Triangles::default() };
    let mut out = Vec::with_capacity(count);
    for &code in codes {
        let triangle = match code {
            0xf0.. => state.free(code, table)?,
            _ => state.on_edge(code)?,
        };
        out.extend(triangle);
    }
    state.data.is_empty().then_some(out)
}

impl Triangles<'_> {
    /// A triangle that shares a recent edge.
    fn on_edge(&mut self, code: u8) -> Option<[u32; 3]> {
        let [a, b] = self.edges.get(usize::from(code >> 4))?;
        let (c, is_new) = match code & 15 {
            0 => (self.take_next(), true),
            recent @ 1..0xd => (self.vertices.get(usize::from(recent))?, false),
            0xd => (self.last.wrapping_sub(1), true),
            0xe => (self.last.wrapping_add(1), true),
            _ => (self.read_index()?, true),
        };
        if code & 15 >= 0xd {
            self.last = c;
        }
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        if is_new {
            self.vertices.push(c);
        }
        Some([a, b, c])
    }

    /// A triangle without a recent edge. Two numbers say where its second and third vertices come from; `table` holds the
    /// usual pairs.
    fn free(&mut self, code: u8, table: &[u8]) -> Option<[u32; 3]> {
        let pair = match code {
            0xfe.. => take(&mut self.data, 1)?[0],
            _ => table[usize::from(code & 15)],
        };
        if code >= 0xfe && pair == 0 {
            self.next = 0;
        }
        let a = if code == 0xff { self.read_index()? } else { self.take_next() };
        let b = self.source(pair >> 4)?;
        let c = self.source(pair & 15)?;
        self.edges.push([b, a]);
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        self.vertices.push(a);
        for (vertex, source) in [(b, pair >> 4), (c, pair & 15)] {
            if matches!(source, 0 | 15) {
                self.vertices.push(vertex);
            }
        }
        Some([a, b, c])
    }

    /// A vertex: the next one, a recent one, or one in the extra data.
    fn source(&mut self, source: u8) -> Option<u32> {
        match source {
            0 => Some(self.take_next()),
            15 => self.read_index(),
            recent => self.vertices.get(usize::from(recent) - 1),
        }
    }

    fn take_next(&mut self) -> u32 {
        self.next = self.next.wrapping_add(1);
        self.next.wrapping_sub(1)
    }

    fn read_index(&mut self) -> Option<u32> {
        let code = varint(&mut self.data)?;
        self.last = self.last.wrapping_add(code >> 1 ^ (code & 1).wrapping_neg());
        Some(self.last)
    }
}
