// Where the numbers of multi-layer perceptrons lie: one network, or several networks of equal shape
// as members of one object.
//
// MlpLayout says where each layer's numbers lie in one flat parameter buffer; gradients, targets
// and optimiser moments use the same layout, so Adam, Polyak averaging and checkpoints are one loop
// each. A weight is stored as PyTorch stores it, (outputs, inputs) row-major, and a layer's members
// follow each other. Thread rule: immutable.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "algorithms/nn/parameters.h"
#include "proto/base/rng.h"

namespace b4mrl {

enum class Activation {
  kRelu,
  kSwish,  // x * sigmoid(x)
};

struct MlpShape {
  int members = 1;
  int inputs = 0;           // of one member
  std::vector<int> hidden;  // widths of one member, at least one
  int outputs = 0;          // of one member; the output layer is linear
  Activation activation = Activation::kRelu;
};

enum class Initialization {
  kTorchUniform,     // weight and bias ~ U(-1/sqrt(inputs), 1/sqrt(inputs)): torch.nn.Linear
  kTruncatedNormal,  // weight ~ N(0, 1/(4 inputs)) within two deviations, bias 0: MOPO's original
  kOrthogonal,       // nn/orthogonal.h with gain sqrt(2), bias 0: IQL's original
};

class MlpLayout {
 public:
  // Sizes of one layer, and the offsets of its arrays in a flat buffer, in numbers.
  struct Layer {
    int inputs;           // of one member
    int outputs;          // of one member
    int64_t weight;       // offset of the weight (members, outputs, inputs)
    int64_t bias;         // offset of the bias (members, outputs)
    int64_t weight_size;  // members * outputs * inputs
    int64_t bias_size;    // members * outputs
  };

  explicit MlpLayout(MlpShape shape);

  const MlpShape& shape() const { return shape_; }
  int members() const { return shape_.members; }
  const std::vector<Layer>& layers() const { return layers_; }
  // Length of a flat buffer. Arrays start on cache lines; gaps between them stay zero in updates.
  int64_t size() const { return size_; }

  // Calls body(first, size) for each array of one member in a flat buffer.
  template <typename Body>
  void ForEachRange(int member, Body body) const {
    for (const Layer& layer : layers_) {
      const int64_t weights = layer.weight_size / shape_.members;
      const int64_t biases = layer.bias_size / shape_.members;
      body(layer.weight + member * weights, weights);
      body(layer.bias + member * biases, biases);
    }
  }

  // Draws initial weights into `parameters`, layer by layer and member by member.
  template <typename Scalar>
  void Initialize(Initialization initialization, Rng& rng, std::span<Scalar> parameters) const;
  // Draws the output layer again: weight ~ U(-b, b), b = gain sqrt(6 / (inputs + outputs)), and
  // bias 0 (Glorot and Bengio 2010).
  template <typename Scalar>
  void InitializeHead(double gain, Rng& rng, std::span<Scalar> parameters) const;

  // Visits each layer's arrays in `parameters` as "<prefix>/layer<i>/weight" and ".../bias".
  template <typename Scalar>
  void Visit(std::string_view prefix, std::span<Scalar> parameters,
             const ArrayVisitor<Scalar>& visitor) const;

 private:
  MlpShape shape_;
  std::vector<Layer> layers_;
  int64_t size_ = 0;
};

}  // namespace b4mrl
