// Reads the arrays that reference/dump_pytorch.py wrote (its docstring is the format), and compares
// a core's arrays with them.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "algorithms/cores/actor_critic.h"
#include "algorithms/cores/transition_batch.h"
#include "algorithms/nn/parameters.h"
#include "algorithms/nn/products/view.h"

namespace b4mrl {

class ReferenceFile {
 public:
  struct Array {
    std::vector<int> shape;
    std::vector<double> values;
  };

  // Fails the running test when the file is missing or malformed. `name`: "sac.ref".
  explicit ReferenceFile(const std::string& name);

  const Array& Get(const std::string& name) const;
  // As a features x batch matrix: the file's arrays are batch x features, row-major.
  template <typename Scalar>
  MatrixBuffer<Scalar> Matrix(const std::string& name) const;
  // A step's normals as SoftActor::DrawNoise has them: columns for a, then for a'.
  template <typename Scalar>
  MatrixBuffer<Scalar> ActionNoise(const std::string& step) const;
  template <typename Scalar>
  std::vector<Scalar> Vector(const std::string& name) const;

  // Copies the array "<prefix>/<array.name>" into the array.
  template <typename Scalar>
  void Load(const std::string& prefix, const NamedArray<Scalar>& array) const;
  // The largest |array - reference| / largest |reference| for "<prefix>/<array.name>".
  template <typename Scalar>
  double Difference(const std::string& prefix, const NamedArray<Scalar>& array) const;

 private:
  std::map<std::string, Array> arrays_;
};

// The sizes of a core whose batch and initial actor are in the file.
void SetReferenceSizes(const ReferenceFile& file, ActorCriticOptions* options);

// The transitions under "<prefix>/", and the storage their views look at.
template <typename Scalar>
struct ReferenceBatch {
  explicit ReferenceBatch(const ReferenceFile& file, const std::string& prefix = "batch");
  TransitionBatch<Scalar> Views() const;

  MatrixBuffer<Scalar> observations, actions, next_observations;
  std::vector<Scalar> rewards, not_terminated;
};

}  // namespace b4mrl
