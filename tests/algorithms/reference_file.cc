#include "tests/algorithms/reference_file.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>

namespace b4mrl {
namespace {

class Bytes {
 public:
  explicit Bytes(std::vector<char> bytes) : bytes_(std::move(bytes)) {}
  uint32_t Number() {
    uint32_t number = 0;
    Copy(&number, sizeof(number));
    return number;
  }
  void Copy(void* to, size_t size) {
    REQUIRE(size <= bytes_.size() - position_);
    if (size > 0) std::memcpy(to, bytes_.data() + position_, size);
    position_ += size;
  }

 private:
  std::vector<char> bytes_;
  size_t position_ = 0;
};

}  // namespace

ReferenceFile::ReferenceFile(const std::string& name) {
  const std::string path = B4MRL_SOURCE_DIR "/tests/algorithms/reference/" + name;
  std::ifstream stream(path, std::ios::binary);
  INFO(path);
  REQUIRE(stream.good());
  Bytes bytes(std::vector<char>(std::istreambuf_iterator<char>(stream), {}));
  char magic[8];
  bytes.Copy(magic, sizeof(magic));
  REQUIRE(std::string_view(magic, sizeof(magic)) == "B4MRLREF");
  for (uint32_t count = bytes.Number(); count > 0; --count) {
    std::string array_name(bytes.Number(), ' ');
    bytes.Copy(array_name.data(), array_name.size());
    Array& array = arrays_[array_name];
    array.shape.resize(bytes.Number());
    size_t size = 1;
    for (int& extent : array.shape) {
      extent = static_cast<int>(bytes.Number());
      size *= extent;
    }
    array.values.resize(size);
    bytes.Copy(array.values.data(), size * sizeof(double));
  }
}

const ReferenceFile::Array& ReferenceFile::Get(const std::string& name) const {
  const auto found = arrays_.find(name);
  INFO(name);
  REQUIRE(found != arrays_.end());
  return found->second;
}

template <typename Scalar>
MatrixBuffer<Scalar> ReferenceFile::Matrix(const std::string& name) const {
  const Array& array = Get(name);
  REQUIRE(array.shape.size() == 2);
  MatrixBuffer<Scalar> matrix(array.shape[1], array.shape[0]);
  std::transform(array.values.begin(), array.values.end(), matrix.view().data,
                 [](double value) { return static_cast<Scalar>(value); });
  return matrix;
}

template <typename Scalar>
MatrixBuffer<Scalar> ReferenceFile::ActionNoise(const std::string& step) const {
  const MatrixBuffer<Scalar> noise = Matrix<Scalar>(step + "/noise");
  const MatrixBuffer<Scalar> next_noise = Matrix<Scalar>(step + "/next_noise");
  MatrixBuffer<Scalar> both(noise.rows(), 2 * noise.columns());
  const auto second = std::ranges::copy(noise.values(), both.values().begin()).out;
  std::ranges::copy(next_noise.values(), second);
  return both;
}

template <typename Scalar>
std::vector<Scalar> ReferenceFile::Vector(const std::string& name) const {
  const Array& array = Get(name);
  return {array.values.begin(), array.values.end()};
}

template <typename Scalar>
void ReferenceFile::Load(const std::string& prefix, const NamedArray<Scalar>& array) const {
  const Array& reference = Get(prefix + "/" + array.name);
  REQUIRE(reference.shape == array.shape);
  std::transform(reference.values.begin(), reference.values.end(), array.values.begin(),
                 [](double value) { return static_cast<Scalar>(value); });
}

template <typename Scalar>
double ReferenceFile::Difference(const std::string& prefix, const NamedArray<Scalar>& array) const {
  const Array& reference = Get(prefix + "/" + array.name);
  REQUIRE(reference.values.size() == array.values.size());
  double worst = 0;
  double largest = 0;
  for (size_t i = 0; i < array.values.size(); ++i) {
    const double difference = std::abs(array.values[i] - reference.values[i]);
    worst = difference <= worst ? worst : difference;  // NaN wins
    largest = std::max(largest, std::abs(reference.values[i]));
  }
  return worst == 0 ? 0 : worst / largest;
}

void SetReferenceSizes(const ReferenceFile& file, ActorCriticOptions* options) {
  const std::vector<int>& batch = file.Get("batch/observations").shape;
  options->observation_size = batch[1];
  options->action_size = file.Get("batch/actions").shape[1];
  options->hidden = {file.Get("initial/actor/layer0/bias").shape[0],
                     file.Get("initial/actor/layer1/bias").shape[0]};
  options->batch_max = batch[0];
}

template <typename Scalar>
ReferenceBatch<Scalar>::ReferenceBatch(const ReferenceFile& file, const std::string& prefix)
    : observations(file.Matrix<Scalar>(prefix + "/observations")),
      actions(file.Matrix<Scalar>(prefix + "/actions")),
      next_observations(file.Matrix<Scalar>(prefix + "/next_observations")),
      rewards(file.Vector<Scalar>(prefix + "/rewards")),
      not_terminated(file.Vector<Scalar>(prefix + "/not_terminated")) {}

template <typename Scalar>
TransitionBatch<Scalar> ReferenceBatch<Scalar>::Views() const {
  return {observations.view(), actions.view(), rewards, next_observations.view(), not_terminated};
}

#define B4MRL_INSTANTIATE(Scalar)                                                                  \
  template MatrixBuffer<Scalar> ReferenceFile::Matrix<Scalar>(const std::string&) const;           \
  template MatrixBuffer<Scalar> ReferenceFile::ActionNoise<Scalar>(const std::string&) const;      \
  template std::vector<Scalar> ReferenceFile::Vector<Scalar>(const std::string&) const;            \
  template void ReferenceFile::Load<Scalar>(const std::string&, const NamedArray<Scalar>&) const;  \
  template double ReferenceFile::Difference<Scalar>(const std::string&, const NamedArray<Scalar>&) \
      const;                                                                                       \
  template struct ReferenceBatch<Scalar>;
B4MRL_INSTANTIATE(float)
B4MRL_INSTANTIATE(double)
#undef B4MRL_INSTANTIATE

}  // namespace b4mrl
