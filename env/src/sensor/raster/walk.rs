//! Front to back through the index: what is hidden behind drawn tiles is skipped with all that it holds.

use super::index::{Child, RasterIndex, WIDE};
use super::tiles::Tiles;
use super::view::{Extent, View};

/// A box waiting to be opened.
#[derive(Clone, Copy, Default)]
pub(super) struct Waiting {
    child: Child,
    extent: Extent,
}

/// Draws all that the view sees.
#[inline(always)]
pub(super) fn walk(index: &RasterIndex, view: &View, tiles: &mut Tiles, stack: &mut Vec<Waiting>) {
    stack.clear();
    open(index, view, 0, stack);
    while let Some(Waiting { child, extent }) = stack.pop() {
        // Asked when its turn has come: by now, nearer boxes are drawn.
        if !tiles.may_show(&extent) {
            continue;
        }
        if child.packets == 0 {
            open(index, view, child.first as usize, stack);
            continue;
        }
        for packet in &index.packets[child.first as usize..][..child.packets as usize] {
            let projected = view.project(packet);
            for lane in 0..packet.len {
                let extent = view.extent(&projected, lane);
                if tiles.may_show(&extent) {
                    if let Some(triangle) = view.triangle(packet, &projected, lane, extent) {
                        tiles.draw(&triangle);
                    }
                }
            }
        }
    }
}

/// Puts the children of a node that lie in the view on the stack, the nearest on top.
#[inline(always)]
fn open(index: &RasterIndex, view: &View, node: usize, stack: &mut Vec<Waiting>) {
    let node = &index.nodes[node];
    let extents = view.extents(node);
    let first = stack.len();
    for lane in 0..node.len.min(WIDE) {
        let extent = extents[lane];
        if extent.x0 < extent.x1 && extent.y0 < extent.y1 {
            // Insertion from the top: at most eight, and often in order.
            let mut place = stack.len();
            stack.push(Waiting { child: node.child[lane], extent });
            while place > first && stack[place - 1].extent.nearest > stack[place].extent.nearest {
                stack.swap(place - 1, place);
                place -= 1;
            }
        }
    }
}
