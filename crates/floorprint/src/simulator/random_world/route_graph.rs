//! Where a robot can drive, and a drive at random along it.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Crossings, and the straight lanes between them.
#[derive(Debug, Clone, Default)]
pub(in crate::simulator) struct RouteGraph {
    /// Where the crossings are, metres.
    pub(super) nodes: Vec<[f64; 2]>,
    neighbours: Vec<Vec<usize>>,
}

impl RouteGraph {
    /// A new crossing.
    pub(super) fn node(&mut self, position_m: [f64; 2]) -> usize {
        self.nodes.push(position_m);
        self.neighbours.push(Vec::new());
        self.nodes.len() - 1
    }

    /// A lane between two crossings.
    pub(super) fn join(&mut self, a: usize, b: usize) {
        if a != b {
            self.neighbours[a].push(b);
            self.neighbours[b].push(a);
        }
    }

    /// A grid of lanes; the crossing of column `c` and row `r` is the first one returned plus `c * ys.len() + r`.
    pub(super) fn grid(&mut self, xs: &[f64], ys: &[f64]) -> usize {
        let first = self.nodes.len();
        for &x in xs {
            for &y in ys {
                self.node([x, y]);
            }
        }
        for column in 0..xs.len() {
            for row in 0..ys.len() {
                let here = first + column * ys.len() + row;
                if row + 1 < ys.len() {
                    self.join(here, here + 1);
                }
                if column + 1 < xs.len() {
                    self.join(here, here + ys.len());
                }
            }
        }
        first
    }

    /// A crossing on the way from one to another, in place of the lane that joins them.
    pub(super) fn split(&mut self, a: usize, b: usize, position_m: [f64; 2]) -> usize {
        self.neighbours[a].retain(|&node| node != b);
        self.neighbours[b].retain(|&node| node != a);
        let middle = self.node(position_m);
        self.join(a, middle);
        self.join(middle, b);
        middle
    }

    /// Takes in another one's crossings, numbered after its own.
    pub(super) fn append(&mut self, other: Self) {
        let first = self.nodes.len();
        self.nodes.extend(other.nodes);
        let renumbered = other.neighbours.into_iter().map(|list| list.into_iter().map(|node| first + node).collect());
        self.neighbours.extend(renumbered);
    }

    /// The crossing farthest to the east; the southernmost of several.
    pub(super) fn easternmost(&self) -> usize {
        let key = |&node: &usize| self.nodes[node][0] * 1e3 - self.nodes[node][1];
        (0..self.nodes.len()).max_by(|a, b| key(a).total_cmp(&key(b))).unwrap_or(0)
    }

    /// The crossing farthest to the west; the southernmost of several.
    pub(super) fn westernmost(&self) -> usize {
        let key = |&node: &usize| self.nodes[node][0] * 1e3 + self.nodes[node][1];
        (0..self.nodes.len()).min_by(|a, b| key(a).total_cmp(&key(b))).unwrap_or(0)
    }

    fn length_m(&self, a: usize, b: usize) -> f64 {
        let ([ax, ay], [bx, by]) = (self.nodes[a], self.nodes[b]);
        (bx - ax).hypot(by - ay)
    }

    /// A drive about so long, metres, that rather takes what is new; half of them end where they began, unless that
    /// would make them half as long again.
    pub(in crate::simulator) fn walk(&self, random: &mut Pcg64Mcg, length_m: f64) -> Vec<[f64; 2]> {
        let start = random.random_range(0..self.nodes.len());
        let mut visits = vec![0_u32; self.nodes.len()];
        let (mut here, mut before, mut driven_m) = (start, usize::MAX, 0.0);
        let mut route = vec![start];
        visits[start] += 1;
        while driven_m < length_m {
            let mut ways: Vec<usize> = self.neighbours[here].iter().copied().filter(|&node| node != before).collect();
            if ways.is_empty() {
                ways.clone_from(&self.neighbours[here]);
            }
            let Some(fewest) = ways.iter().map(|&node| visits[node]).min() else { break };
            if random.random_bool(0.75) {
                ways.retain(|&node| visits[node] == fewest);
            }
            let next = ways[random.random_range(0..ways.len())];
            driven_m += self.length_m(here, next);
            (before, here) = (here, next);
            visits[here] += 1;
            route.push(here);
        }
        if random.random_bool(0.5) {
            let home = self.shortest_way(here, start);
            let home_m: f64 = home.windows(2).map(|pair| self.length_m(pair[0], pair[1])).sum();
            if home_m < 0.5 * length_m {
                route.extend(home.into_iter().skip(1));
            }
        }
        route.into_iter().map(|node| self.nodes[node]).collect()
    }

    /// Dijkstra's algorithm.
    fn shortest_way(&self, from: usize, to: usize) -> Vec<usize> {
        let mut distances_m = vec![f64::INFINITY; self.nodes.len()];
        let mut previous = vec![usize::MAX; self.nodes.len()];
        let mut is_done = vec![false; self.nodes.len()];
        distances_m[from] = 0.0;
        let nearest = |distances_m: &[f64], is_done: &[bool]| {
            let open = (0..distances_m.len()).filter(|&node| !is_done[node] && distances_m[node].is_finite());
            open.min_by(|&a, &b| distances_m[a].total_cmp(&distances_m[b]))
        };
        while let Some(node) = nearest(&distances_m, &is_done) {
            is_done[node] = true;
            for &next in &self.neighbours[node] {
                let over_m = distances_m[node] + self.length_m(node, next);
                if over_m < distances_m[next] {
                    (distances_m[next], previous[next]) = (over_m, node);
                }
            }
        }
        let mut way = vec![to];
        while let Some(&node) = way.last().filter(|&&node| node != from && previous[node] != usize::MAX) {
            way.push(previous[node]);
        }
        way.reverse();
        way
    }
}
