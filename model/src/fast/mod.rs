//! Our own convolution, batch norm and the like for the CPU back end, which decide how much a short training run can learn.
//!
//! Burn's `flex` runs both directions of a convolution's backward pass as generic convolutions over permuted copies,
//! and batch norm as a chain of passes over memory. Here 3×3 convolutions are Winograd's (`winograd`; direct ones for
//! odd sides, and of one pixel, in `conv` over `kernel`), norms, pools, activations and the step of AdamW single passes
//! (`norm`, `planes`, `activation`, `adamw`), all registered as operations of Burn (`ops`). Every other device takes
//! Burn's own operators, as does `flex` after [`enable`]`(false)`. Results are the same bytes for any number of
//! threads: each number is summed by one task in one order.

mod activation;
mod adamw;
mod buffer;
mod conv;
mod kernel;
mod norm;
mod ops;
mod planes;
mod up;
mod winograd;

pub(crate) use adamw::Rule;
use burn::backend::Dispatch;
use burn::prelude::*;
use burn::tensor::DType;
use ops::FastOps;
use std::sync::atomic::{AtomicBool, Ordering};

static ENABLED: AtomicBool = AtomicBool::new(true);

/// Turns the kernels on (as they are at first) or off for the whole program, to compare them with Burn's operators.
pub fn enable(on: bool) {
    ENABLED.store(on, Ordering::Relaxed);
}

/// Whether the kernels can take this tensor.
pub(crate) fn takes<const D: usize>(x: &Tensor<D>) -> bool {
    // Devices are equal whether they record a tape or not.
    ENABLED.load(Ordering::Relaxed) && x.dtype() == DType::F32 && x.device() == Device::flex()
}

/// Whether the kernels can do this convolution.
fn convolves(x_bchw: &Tensor<4>, weight: &Tensor<4>, doubled: bool) -> bool {
    let [_, _, rows, cols] = weight.dims();
    takes(x_bchw) && rows == cols && (rows == 3 || rows == 1 && !doubled)
}

/// Same-size convolution, of the input at twice its size if `doubled`; `None` if Burn has to do it.
///
/// # Shapes
/// `[b, in, h, w]`, `[out, in, k, k]`, `[out]` → `[b, out, h, w]` or `[b, out, 2h, 2w]`.
pub(crate) fn conv(x_bchw: &Tensor<4>, weight: &Tensor<4>, bias: &Tensor<1>, doubled: bool) -> Option<Tensor<4>> {
    convolves(x_bchw, weight, doubled).then(|| {
        let (x, weight, bias) = (x_bchw.clone().into_dispatch(), weight.clone().into_dispatch(), bias.clone());
        Tensor::from_dispatch(<Dispatch as FastOps>::fast_conv(x, weight, bias.into_dispatch(), doubled))
    })
}

/// 2×2 maximum pool of even sides, `None` if Burn has to do it.
pub fn pool(x_bchw: &Tensor<4>) -> Option<Tensor<4>> {
    let [_, _, h, w] = x_bchw.dims();
    let known = h.is_multiple_of(2) && w.is_multiple_of(2);
    (takes(x_bchw) && known)
        .then(|| Tensor::from_dispatch(<Dispatch as FastOps>::fast_pool(x_bchw.clone().into_dispatch())))
}

/// `[b, c, h, w]` · `[b, 1, h, w]`, `None` if Burn has to do it.
pub fn scale(x_bchw: &Tensor<4>, factor_b1hw: &Tensor<4>) -> Option<Tensor<4>> {
    takes(x_bchw).then(|| {
        let (x, factor) = (x_bchw.clone().into_dispatch(), factor_b1hw.clone().into_dispatch());
        Tensor::from_dispatch(<Dispatch as FastOps>::fast_scale(x, factor))
    })
}

/// [`conv`], then [`norm`] with given `[mean, var]` behind `[weight, bias]`, as one operation; `None` if Burn has to do it.
pub(crate) fn conv_norm(
    x_bchw: &Tensor<4>,
    kernel: &Tensor<4>,
    kernel_bias: &Tensor<1>,
    doubled: bool,
    channels: [Tensor<1>; 4],
    epsilon: f64,
    relu: bool,
) -> Option<Tensor<4>> {
    convolves(x_bchw, kernel, doubled).then(|| {
        let (x, kernel, kernel_bias) = (x_bchw.clone(), kernel.clone(), kernel_bias.clone());
        let [weight, bias, mean, var] = channels.map(Tensor::into_dispatch);
        let (x, kernel, kernel_bias) = (x.into_dispatch(), kernel.into_dispatch(), kernel_bias.into_dispatch());
        let epsilon = epsilon as f32;
        Tensor::from_dispatch(<Dispatch as FastOps>::fast_conv_norm(
            x,
            kernel,
            kernel_bias,
            doubled,
            weight,
            bias,
            mean,
            var,
            epsilon,
            relu,
        ))
    })
}

/// What [`norm_train`] found.
pub(crate) struct Normed {
    /// `[b, c, h, w]`.
    pub(crate) y_bchw: Tensor<4>,
    /// `[c]`.
    pub(crate) mean: Tensor<1>,
    /// `[c]`, biased.
    pub(crate) var: Tensor<1>,
}

/// Batch norm with the batch's statistics, and ReLU if asked for; `None` if Burn has to do it.
pub(crate) fn norm_train(
    x_bchw: &Tensor<4>,
    weight: &Tensor<1>,
    bias: &Tensor<1>,
    epsilon: f64,
    relu: bool,
) -> Option<Normed> {
    takes(x_bchw).then(|| {
        let (x, weight, bias) = (x_bchw.clone(), weight.clone(), bias.clone());
        let (x, weight, bias) = (x.into_dispatch(), weight.into_dispatch(), bias.into_dispatch());
        let (y, mean, var) = <Dispatch as FastOps>::fast_norm_train(x, weight, bias, epsilon as f32, relu);
        Normed { y_bchw: Tensor::from_dispatch(y), mean: Tensor::from_dispatch(mean), var: Tensor::from_dispatch(var) }
    })
}

/// Batch norm with given `[mean, var]` behind `[weight, bias]`, and ReLU if asked for; `None` if Burn has to do it.
pub(crate) fn norm(x_bchw: &Tensor<4>, channels: [Tensor<1>; 4], epsilon: f64, relu: bool) -> Option<Tensor<4>> {
    takes(x_bchw).then(|| {
        let [weight, bias, mean, var] = channels.map(Tensor::into_dispatch);
        let x = x_bchw.clone().into_dispatch();
        Tensor::from_dispatch(<Dispatch as FastOps>::fast_norm(x, weight, bias, mean, var, epsilon as f32, relu))
    })
}

/// GELU, by Burn where the kernels cannot.
pub(crate) fn gelu<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    match takes(&x) {
        true => Tensor::from_dispatch(<Dispatch as FastOps>::fast_gelu(x.into_dispatch())),
        false => burn::tensor::activation::gelu(x),
    }
}

/// Softmax of the last axis, by Burn where the kernels cannot.
pub(crate) fn softmax<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    match takes(&x) {
        true => Tensor::from_dispatch(<Dispatch as FastOps>::fast_softmax(x.into_dispatch())),
        false => burn::tensor::activation::softmax(x, D - 1),
    }
}

/// A step of AdamW on a tensor that it [`takes`]: weights, gradient and the two moments → weights and moments.
pub(crate) fn adamw<const D: usize>(
    rule: Rule,
    weight: Tensor<D>,
    gradient: Tensor<D>,
    moments: [Tensor<D>; 2],
) -> [Tensor<D>; 3] {
    let [first, second] = moments.map(Tensor::into_dispatch);
    let (weight, gradient) = (weight.into_dispatch(), gradient.into_dispatch());
    let (weight, first, second) = <Dispatch as FastOps>::fast_adamw(weight, gradient, first, second, rule);
    [weight, first, second].map(Tensor::from_dispatch)
}
