//! A fully connected layer on one row.

/// Outputs that are summed side by side: as many as hide the time of an addition in registers of any width.
/// Half of that is four times slower: the compiler takes it apart into single sums.
const LANES: usize = 32;

/// `y = W·x + b`.
///
/// Every output is summed in the order of the inputs, each product rounded before it is added, so that
/// vector instructions of any width give the same bytes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Dense {
    inputs: usize,
    outputs: usize,
    /// By block of [`LANES`] outputs, then input, then output; padded with zeros.
    weights: Vec<[f32; LANES]>,
    bias: Vec<[f32; LANES]>,
}

impl Dense {
    /// The layer with weight `weight(output, input)`.
    pub(super) fn new(inputs: usize, bias: &[f32], weight: impl Fn(usize, usize) -> f32) -> Self {
        let outputs = bias.len();
        let blocks = outputs.div_ceil(LANES);
        let lane = |block: usize, value: &dyn Fn(usize) -> f32| {
            std::array::from_fn(|lane| {
                let output = block * LANES + lane;
                if output < outputs { value(output) } else { 0.0 }
            })
        };
        let mut weights = Vec::with_capacity(blocks * inputs);
        for block in 0..blocks {
            for input in 0..inputs {
                weights.push(lane(block, &|output| weight(output, input)));
            }
        }
        let bias = (0..blocks).map(|block| lane(block, &|output| bias[output])).collect();
        Self { inputs, outputs, weights, bias }
    }

    pub(super) fn outputs(&self) -> usize {
        self.outputs
    }

    /// `x` has the layer's inputs, `y` its outputs.
    pub(super) fn run(&self, x: &[f32], y: &mut [f32]) {
        let blocks = self.weights.chunks_exact(self.inputs).zip(&self.bias);
        for ((weights, bias), y) in blocks.zip(y.chunks_mut(LANES)) {
            let mut sums = *bias;
            for (row, &x) in weights.iter().zip(x) {
                for (sum, weight) in sums.iter_mut().zip(row) {
                    *sum += weight * x;
                }
            }
            y.copy_from_slice(&sums[..y.len()]);
        }
    }
}
