//! The kernels as operations of Burn, through its extension point for back ends.

use super::adamw::{self, Rule};
use super::conv::{self, Geometry, Kernels};
use super::kernel::Machine;
use super::norm::{self, Channels, Planes};
use super::{activation, planes, up};
use burn::backend::autodiff::NodeId;
use burn::backend::autodiff::checkpoint::{
    base::Checkpointer, retro_forward::RetroForward, state::BackwardStates, strategy::CheckpointStrategy,
};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Flex, backend_extension};
use burn::tensor::TensorData;

type Flexed = FloatTensor<Flex>;

/// What `fast` adds to Burn's CPU back end.
#[backend_extension(Autodiff, Flex)]
pub(super) trait FastOps: Backend {
    /// Same-size convolution: `[b, in, h, w]`, `[out, in, k, k]`, `[out]` → `[b, out, h, w]`.
    /// If `doubled`, the input is seen at twice its size, by nearest neighbour.
    fn fast_conv(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        doubled: bool,
    ) -> FloatTensor<Self>;

    /// [`Self::fast_conv`], then [`Self::fast_norm`], as one operation; not differentiable.
    #[allow(clippy::too_many_arguments)] // tensors of an operation come one by one
    fn fast_conv_norm(
        x: FloatTensor<Self>,
        kernel: FloatTensor<Self>,
        kernel_bias: FloatTensor<Self>,
        doubled: bool,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        mean: FloatTensor<Self>,
        var: FloatTensor<Self>,
        epsilon: f32,
        relu: bool,
    ) -> FloatTensor<Self>;

    /// Batch norm with the batch's statistics: `[b, c, h, w]`, `[c]`, `[c]` → the same, mean and biased variance.
    fn fast_norm_train(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        epsilon: f32,
        relu: bool,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);

    /// Batch norm with given statistics; not differentiable.
    fn fast_norm(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        mean: FloatTensor<Self>,
        var: FloatTensor<Self>,
        epsilon: f32,
        relu: bool,
    ) -> FloatTensor<Self>;

    /// 2×2 maximum pool.
    fn fast_pool(x: FloatTensor<Self>) -> FloatTensor<Self>;

    /// Planes times one plane: `[b, c, h, w]` · `[b, 1, h, w]`.
    fn fast_scale(x: FloatTensor<Self>, factor: FloatTensor<Self>) -> FloatTensor<Self>;

    /// GELU.
    fn fast_gelu(x: FloatTensor<Self>) -> FloatTensor<Self>;

    /// Softmax of the last axis.
    fn fast_softmax(x: FloatTensor<Self>) -> FloatTensor<Self>;

    /// A step of AdamW: weights, gradient and moments → weights and moments; not differentiable.
    fn fast_adamw(
        weight: FloatTensor<Self>,
        gradient: FloatTensor<Self>,
        first: FloatTensor<Self>,
        second: FloatTensor<Self>,
        rule: Rule,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
}

/// The numbers of a tensor in row-major order, copied only if they do not lie so.
fn contiguous(tensor: Flexed) -> Flexed {
    if tensor.as_slice::<f32>().is_some() { tensor } else { tensor.to_contiguous() }
}

/// A [`contiguous`] tensor that is not part of a larger one.
fn whole(part: Flexed) -> Flexed {
    let part = contiguous(part);
    let count = numbers(&part).len();
    if part.storage::<f32>().len() == count {
        part
    } else {
        tensor(numbers(&part).to_vec(), part.layout().shape().as_slice())
    }
}

/// The numbers of a [`contiguous`] tensor.
fn numbers(tensor: &Flexed) -> &[f32] {
    tensor.as_slice().unwrap_or_else(|| unreachable!("tensors are made contiguous f32 before they get here"))
}

fn tensor(numbers: Vec<f32>, shape: impl Into<Vec<usize>>) -> Flexed {
    Flexed::from_data(TensorData::new(numbers, shape.into()))
}

fn dims<const D: usize>(tensor: &Flexed) -> [usize; D] {
    let shape = tensor.layout().shape().as_slice();
    std::array::from_fn(|axis| shape[axis])
}

/// Numbers along the last axis.
fn last(tensor: &Flexed) -> usize {
    tensor.layout().shape().as_slice().last().copied().unwrap_or(1)
}

fn geometry(x: &Flexed, weight: &Flexed) -> Geometry {
    let [batch, cin, height, width] = dims(x);
    let [cout, _, kernel, _] = dims(weight);
    Geometry { batch, cin, cout, height, width, kernel }
}

fn plane_sizes(x: &Flexed) -> Planes {
    let [batch, channels, height, width] = dims(x);
    Planes { batch, channels, area: height * width }
}

fn convolved(x: &Flexed, size: Geometry, kernels: Kernels<'_>, doubled: bool) -> Flexed {
    let forward = if doubled { up::forward } else { conv::forward };
    let times = if doubled { 2 } else { 1 };
    let out = forward(Machine::new(), size, numbers(x), kernels);
    tensor(out, [size.batch, size.cout, times * size.height, times * size.width])
}

impl FastOps for Flex {
    fn fast_conv(x: Flexed, weight: Flexed, bias: Flexed, doubled: bool) -> Flexed {
        let [x, weight, bias] = [x, weight, bias].map(contiguous);
        let kernels = Kernels { weight: numbers(&weight), bias: numbers(&bias), scale: None, relu: false };
        convolved(&x, geometry(&x, &weight), kernels, doubled)
    }

    fn fast_conv_norm(
        x: Flexed,
        kernel: Flexed,
        kernel_bias: Flexed,
        doubled: bool,
        weight: Flexed,
        bias: Flexed,
        mean: Flexed,
        var: Flexed,
        epsilon: f32,
        relu: bool,
    ) -> Flexed {
        let [x, kernel, kernel_bias] = [x, kernel, kernel_bias].map(contiguous);
        let [weight, bias, mean, var] = [weight, bias, mean, var].map(contiguous);
        let channels = Channels {
            mean: numbers(&mean),
            var: numbers(&var),
            weight: numbers(&weight),
            bias: numbers(&bias),
            epsilon,
            relu,
        };
        let (scale, bias) = channels.folded(numbers(&kernel_bias));
        let kernels = Kernels { weight: numbers(&kernel), bias: &bias, scale: Some(&scale), relu };
        convolved(&x, geometry(&x, &kernel), kernels, doubled)
    }

    fn fast_norm_train(x: Flexed, weight: Flexed, bias: Flexed, epsilon: f32, relu: bool) -> (Flexed, Flexed, Flexed) {
        let x = contiguous(x);
        let (mean, var) = norm::statistics(plane_sizes(&x), numbers(&x));
        let channels = dims::<2>(&x)[1];
        let (mean, var) = (tensor(mean, [channels]), tensor(var, [channels]));
        (Self::fast_norm(x, weight, bias, mean.clone(), var.clone(), epsilon, relu), mean, var)
    }

    fn fast_norm(
        x: Flexed,
        weight: Flexed,
        bias: Flexed,
        mean: Flexed,
        var: Flexed,
        epsilon: f32,
        relu: bool,
    ) -> Flexed {
        let [x, weight, bias, mean, var] = [x, weight, bias, mean, var].map(contiguous);
        let channels = Channels {
            mean: numbers(&mean),
            var: numbers(&var),
            weight: numbers(&weight),
            bias: numbers(&bias),
            epsilon,
            relu,
        };
        tensor(norm::forward(plane_sizes(&x), numbers(&x), channels), dims::<4>(&x))
    }

    fn fast_pool(x: Flexed) -> Flexed {
        let x = contiguous(x);
        let [batch, channels, height, width] = dims(&x);
        tensor(planes::pool(numbers(&x), width), [batch, channels, height / 2, width / 2])
    }

    fn fast_scale(x: Flexed, factor: Flexed) -> Flexed {
        let (x, factor) = (contiguous(x), contiguous(factor));
        tensor(planes::scale(plane_sizes(&x), numbers(&x), numbers(&factor)), dims::<4>(&x))
    }

    fn fast_gelu(x: Flexed) -> Flexed {
        let mut x = whole(x);
        activation::gelu(x.storage_mut());
        x
    }

    fn fast_softmax(x: Flexed) -> Flexed {
        let mut x = whole(x);
        let row = last(&x);
        activation::softmax(x.storage_mut(), row);
        x
    }

    fn fast_adamw(
        weight: Flexed,
        gradient: Flexed,
        first: Flexed,
        second: Flexed,
        rule: Rule,
    ) -> (Flexed, Flexed, Flexed) {
        let (gradient, mut first, mut second) = (contiguous(gradient), whole(first), whole(second));
        // The weights in place where nobody else holds them.
        let (mut weight, before) = match whole(weight) {
            weight if weight.is_unique() => (weight, None),
            shared => (tensor(vec![0.0; numbers(&shared).len()], shared.layout().shape().as_slice()), Some(shared)),
        };
        let before = before.as_ref().map(numbers);
        adamw::step(rule, weight.storage_mut(), before, numbers(&gradient), first.storage_mut(), second.storage_mut());
        (weight, first, second)
    }
}

impl<C: CheckpointStrategy> FastOps for Autodiff<Flex, C> {
    fn fast_conv(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        doubled: bool,
    ) -> FloatTensor<Self> {
        let nodes = [x.node(), weight.node(), bias.node()];
        let [kernel, bias] = [weight, bias].map(|tensor| contiguous(tensor.into_primitive()));
        let out = Flex::fast_conv(x.clone().into_primitive(), kernel.clone(), bias, doubled);
        match ConvBackward.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(mut prep) => {
                let x = prep.checkpoint(&x);
                prep.finish(ConvState { x, weight: kernel, doubled }, out)
            }
            OpsKind::UnTracked(prep) => prep.finish(out),
        }
    }

    fn fast_conv_norm(
        x: FloatTensor<Self>,
        kernel: FloatTensor<Self>,
        kernel_bias: FloatTensor<Self>,
        doubled: bool,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        mean: FloatTensor<Self>,
        var: FloatTensor<Self>,
        epsilon: f32,
        relu: bool,
    ) -> FloatTensor<Self> {
        let [x, kernel, kernel_bias] = [x, kernel, kernel_bias].map(|tensor| tensor.into_primitive());
        let [weight, bias, mean, var] = [weight, bias, mean, var].map(|tensor| tensor.into_primitive());
        let found = Flex::fast_conv_norm(x, kernel, kernel_bias, doubled, weight, bias, mean, var, epsilon, relu);
        FloatTensor::<Self>::new(found)
    }

    fn fast_norm_train(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        epsilon: f32,
        relu: bool,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        let nodes = [x.node(), weight.node(), bias.node()];
        let [scale, shift] = [&weight, &bias].map(|tensor| contiguous(tensor.clone().into_primitive()));
        let (out, mean, var) =
            Flex::fast_norm_train(x.clone().into_primitive(), scale.clone(), shift.clone(), epsilon, relu);
        let norm = NormState {
            x: nodes[0].id(),
            weight: scale,
            bias: shift,
            mean: mean.clone(),
            var: var.clone(),
            epsilon,
            relu,
        };
        let prep = NormBackward.prepare::<C>(nodes).memory_bound().retro_forward(norm.clone());
        let out = match prep.parents([&x, &weight, &bias]).stateful() {
            OpsKind::Tracked(mut prep) => {
                prep.checkpoint(&x);
                prep.finish(norm, out)
            }
            OpsKind::UnTracked(prep) => prep.finish(out),
        };
        (out, FloatTensor::<Self>::new(mean), FloatTensor::<Self>::new(var))
    }

    fn fast_norm(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        mean: FloatTensor<Self>,
        var: FloatTensor<Self>,
        epsilon: f32,
        relu: bool,
    ) -> FloatTensor<Self> {
        let [x, weight, bias, mean, var] = [x, weight, bias, mean, var].map(|tensor| tensor.into_primitive());
        FloatTensor::<Self>::new(Flex::fast_norm(x, weight, bias, mean, var, epsilon, relu))
    }

    fn fast_pool(x: FloatTensor<Self>) -> FloatTensor<Self> {
        let out = Flex::fast_pool(x.clone().into_primitive());
        match PoolBackward.prepare::<C>([x.node()]).compute_bound().stateful() {
            OpsKind::Tracked(mut prep) => {
                let x = prep.checkpoint(&x);
                prep.finish(x, out)
            }
            OpsKind::UnTracked(prep) => prep.finish(out),
        }
    }

    fn fast_scale(x: FloatTensor<Self>, factor: FloatTensor<Self>) -> FloatTensor<Self> {
        let nodes = [x.node(), factor.node()];
        let out = Flex::fast_scale(x.clone().into_primitive(), factor.clone().into_primitive());
        match ScaleBackward.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(mut prep) => {
                let state = [prep.checkpoint(&x), prep.checkpoint(&factor)];
                prep.finish(state, out)
            }
            OpsKind::UnTracked(prep) => prep.finish(out),
        }
    }

    fn fast_gelu(x: FloatTensor<Self>) -> FloatTensor<Self> {
        let out = Flex::fast_gelu(x.clone().into_primitive());
        match GeluBackward.prepare::<C>([x.node()]).compute_bound().stateful() {
            OpsKind::Tracked(mut prep) => {
                let x = prep.checkpoint(&x);
                prep.finish(x, out)
            }
            OpsKind::UnTracked(prep) => prep.finish(out),
        }
    }

    fn fast_softmax(x: FloatTensor<Self>) -> FloatTensor<Self> {
        let nodes = [x.node()];
        let out = Flex::fast_softmax(x.into_primitive());
        match SoftmaxBackward.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(out.clone(), out),
            OpsKind::UnTracked(prep) => prep.finish(out),
        }
    }

    fn fast_adamw(
        weight: FloatTensor<Self>,
        gradient: FloatTensor<Self>,
        first: FloatTensor<Self>,
        second: FloatTensor<Self>,
        rule: Rule,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        let [weight, gradient, first, second] = [weight, gradient, first, second].map(|tensor| tensor.into_primitive());
        let (weight, first, second) = Flex::fast_adamw(weight, gradient, first, second, rule);
        (FloatTensor::<Self>::new(weight), FloatTensor::<Self>::new(first), FloatTensor::<Self>::new(second))
    }
}

#[derive(Clone, Debug)]
struct ConvState {
    x: NodeId,
    weight: Flexed,
    doubled: bool,
}

#[derive(Debug)]
struct ConvBackward;

impl Backward<Flex, 3> for ConvBackward {
    type State = ConvState;

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let g = contiguous(grads.consume::<Flex>(&ops.node));
        let ConvState { x, weight, doubled } = ops.state;
        let x = contiguous(checkpointer.retrieve_node_output(x));
        let [node_x, node_weight, node_bias] = ops.parents;
        let size = geometry(&x, &weight);
        let backward = if doubled { up::backward } else { conv::backward };
        let found = backward(Machine::new(), size, numbers(&x), numbers(&weight), numbers(&g), node_x.is_some());
        if let (Some(node), Some(gradient)) = (node_x, found.x) {
            grads.register::<Flex>(node.id, tensor(gradient, dims::<4>(&x)));
        }
        if let Some(node) = node_weight {
            grads.register::<Flex>(node.id, tensor(found.weight, dims::<4>(&weight)));
        }
        if let Some(node) = node_bias {
            grads.register::<Flex>(node.id, tensor(found.bias, [size.cout]));
        }
    }
}

#[derive(Clone, Debug)]
struct NormState {
    x: NodeId,
    weight: Flexed,
    bias: Flexed,
    mean: Flexed,
    var: Flexed,
    epsilon: f32,
    relu: bool,
}

/// Under gradient checkpointing the answer is not kept, but made again.
impl RetroForward for NormState {
    fn forward(&self, states: &mut BackwardStates, out: NodeId) {
        let Self { weight, bias, mean, var, epsilon, relu, .. } = self.clone();
        let x: Flexed = states.get_state(&self.x);
        states.save(out, Flex::fast_norm(x, weight, bias, mean, var, epsilon, relu));
    }
}

#[derive(Debug)]
struct NormBackward;

impl Backward<Flex, 3> for NormBackward {
    type State = NormState;

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let g = contiguous(grads.consume::<Flex>(&ops.node));
        let NormState { x, weight, bias, mean, var, epsilon, relu } = ops.state;
        let x = contiguous(checkpointer.retrieve_node_output(x));
        let channels = Channels {
            mean: numbers(&mean),
            var: numbers(&var),
            weight: numbers(&weight),
            bias: numbers(&bias),
            epsilon,
            relu,
        };
        let found = norm::backward(plane_sizes(&x), numbers(&x), channels, numbers(&g));
        let [node_x, node_weight, node_bias] = ops.parents;
        if let Some(node) = node_x {
            grads.register::<Flex>(node.id, tensor(found.x, dims::<4>(&x)));
        }
        if let Some(node) = node_weight {
            grads.register::<Flex>(node.id, tensor(found.weight, dims::<1>(&weight)));
        }
        if let Some(node) = node_bias {
            grads.register::<Flex>(node.id, tensor(found.bias, dims::<1>(&bias)));
        }
    }
}

#[derive(Debug)]
struct PoolBackward;

impl Backward<Flex, 1> for PoolBackward {
    /// Input.
    type State = NodeId;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let g = contiguous(grads.consume::<Flex>(&ops.node));
        let x = contiguous(checkpointer.retrieve_node_output(ops.state));
        if let [Some(node)] = ops.parents {
            let shape = dims::<4>(&x);
            grads.register::<Flex>(node.id, tensor(planes::pool_backward(numbers(&x), shape[3], numbers(&g)), shape));
        }
    }
}

#[derive(Debug)]
struct ScaleBackward;

impl Backward<Flex, 2> for ScaleBackward {
    /// Planes and factor.
    type State = [NodeId; 2];

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let g = contiguous(grads.consume::<Flex>(&ops.node));
        let [x, factor] = ops.state.map(|tensor| contiguous(checkpointer.retrieve_node_output(tensor)));
        let [node_x, node_factor] = ops.parents;
        if let Some(node) = node_factor {
            let found = planes::scale_backward(plane_sizes(&x), numbers(&x), numbers(&g));
            grads.register::<Flex>(node.id, tensor(found, dims::<4>(&factor)));
        }
        if let Some(node) = node_x {
            grads.register::<Flex>(node.id, Flex::fast_scale(g, factor));
        }
    }
}

#[derive(Debug)]
struct GeluBackward;

impl Backward<Flex, 1> for GeluBackward {
    /// Input.
    type State = NodeId;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, checkpointer: &mut Checkpointer) {
        let mut g = whole(grads.consume::<Flex>(&ops.node));
        let x = contiguous(checkpointer.retrieve_node_output(ops.state));
        if let [Some(node)] = ops.parents {
            activation::gelu_backward(numbers(&x), g.storage_mut());
            grads.register::<Flex>(node.id, g);
        }
    }
}

#[derive(Debug)]
struct SoftmaxBackward;

impl Backward<Flex, 1> for SoftmaxBackward {
    /// Answer.
    type State = Flexed;

    fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let mut g = whole(grads.consume::<Flex>(&ops.node));
        if let [Some(node)] = ops.parents {
            activation::softmax_backward(numbers(&ops.state), g.storage_mut(), last(&ops.state));
            grads.register::<Flex>(node.id, g);
        }
    }
}
