//! Front to back through the index: what is hidden behind drawn tiles is skipped with all that it holds.

use super::image::Image;
use super::index::{Child, LANES, Packet, RasterIndex};
use super::view::{Extent, View};
use std::collections::BinaryHeap;

/// Boxes waiting to be opened.
#[derive(Default)]
pub(super) struct Queue {
    boxes: Vec<(Child, Extent)>,
    /// The nearest first: the bits of 1/depth, which order as the positive numbers do, above the place in `boxes`.
    order: BinaryHeap<u64>,
}

impl Queue {
    fn clear(&mut self) {
        self.boxes.clear();
        self.order.clear();
    }

    #[inline(always)]
    fn push(&mut self, child: Child, extent: Extent) {
        self.order.push(u64::from(extent.nearest.to_bits()) << 32 | self.boxes.len() as u64);
        self.boxes.push((child, extent));
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<(Child, Extent)> {
        self.order.pop().map(|entry| self.boxes[entry as u32 as usize])
    }

    #[inline(always)]
    fn next(&self) -> Option<Child> {
        self.order.peek().map(|&entry| self.boxes[entry as u32 as usize].0)
    }
}

/// Draws all that the view sees.
#[inline(always)]
pub(super) fn walk<const MARKED: bool>(
    index: &RasterIndex,
    view: &View,
    image: &mut Image<'_, MARKED>,
    queue: &mut Queue,
) {
    queue.clear();
    open(index, view, 0, queue);
    while let Some((child, extent)) = queue.pop() {
        // Asked when its turn has come: by now, nearer boxes are drawn.
        if !image.may_show(&extent) {
            continue;
        }
        if let Some(next) = queue.next() {
            index.fetch(next);
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
fn open(index: &RasterIndex, view: &View, node: usize, queue: &mut Queue) {
    let node = &index.nodes[node];
    let extents = view.extents(node);
    for (&extent, &child) in extents.iter().zip(&node.child).take(node.len) {
        if extent.x0 < extent.x1 && extent.y0 < extent.y1 {
            queue.push(child, extent);
        }
    }
}
