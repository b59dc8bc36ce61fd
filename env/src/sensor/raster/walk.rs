//! Front to back through the index: what is hidden behind drawn tiles is skipped with all that it holds.

use super::image::Image;
use super::index::{Child, LANES, Packet, RasterIndex};
use super::view::{Extent, View};
use std::collections::BinaryHeap;

/// A box waiting to be opened, the nearest first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waiting {
    child: Child,
    extent: Extent,
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.extent.nearest.total_cmp(&other.extent.nearest)
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Waiting {}

/// Draws all that the view sees.
#[inline(always)]
pub(super) fn walk<const MARKED: bool>(
    index: &RasterIndex,
    view: &View,
    image: &mut Image<'_, MARKED>,
    queue: &mut BinaryHeap<Waiting>,
) {
    queue.clear();
    open(index, view, 0, queue);
    while let Some(Waiting { child, extent }) = queue.pop() {
        // Asked when its turn has come: by now, nearer boxes are drawn.
        if !image.may_show(&extent) {
            continue;
        }
        if child.packets == 0 {
            open(index, view, child.first as usize, queue);
            continue;
        }
        let places = child.first as usize..(child.first + child.packets) as usize;
        for (packet, place) in index.packets[places.clone()].iter().zip(places) {
            draw(packet, |lane| if MARKED { index.numbers[place][lane] } else { 0 }, view, image);
        }
    }
}

/// Draws the triangles of a packet that may be seen.
#[inline(always)]
fn draw<const MARKED: bool>(
    packet: &Packet,
    number: impl Fn(usize) -> u32,
    view: &View,
    image: &mut Image<'_, MARKED>,
) {
    let projected = view.project(packet);
    let (mut lanes, mut count) = ([(0, Extent::default()); LANES], 0);
    for lane in 0..packet.len.min(LANES) {
        let extent = view.extent(&projected, lane);
        if image.may_show(&extent) {
            lanes[count] = (lane, extent);
            count += 1;
        }
    }
    if count == 0 {
        return;
    }
    let planes = view.planes(packet, &projected);
    for &(lane, extent) in &lanes[..count] {
        if let Some(triangle) = planes.triangle(lane, extent) {
            image.draw(&triangle, number(lane));
        }
    }
    image.refresh();
}

/// Queues the children of a node that lie in the view.
#[inline(always)]
fn open(index: &RasterIndex, view: &View, node: usize, queue: &mut BinaryHeap<Waiting>) {
    let node = &index.nodes[node];
    let extents = view.extents(node);
    for (&extent, &child) in extents.iter().zip(&node.child).take(node.len) {
        if extent.x0 < extent.x1 && extent.y0 < extent.y1 {
            queue.push(Waiting { child, extent });
        }
    }
}
