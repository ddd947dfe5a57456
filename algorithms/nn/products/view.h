// MatrixView: a column-major view of numbers that another object owns.
//
// Every batch in algorithms/ is a matrix of features x batch: one column is one row of a dataset,
// and its features are adjacent in memory. A view is a pointer and three numbers: cheap to copy,
// and copying or assigning a view never copies elements. MatrixView<const T> is read-only. This
// header does not include Eigen, so that learners compile quickly; eigen_map.h adds Eigen's maps.
#pragma once

#include <cstddef>
#include <new>
#include <span>
#include <type_traits>
#include <vector>

namespace b4mrl {

template <typename Scalar>
struct MatrixView {
  Scalar* data = nullptr;
  int rows = 0;
  int columns = 0;
  int stride = 0;  // elements from one column to the next, >= rows

  MatrixView() = default;
  // `stride_or_zero` 0 means densely packed columns.
  MatrixView(Scalar* d, int r, int c, int stride_or_zero = 0)
      : data(d), rows(r), columns(c), stride(stride_or_zero == 0 ? r : stride_or_zero) {}

  operator MatrixView<const Scalar>() const  // NOLINT: a view may always be read
      requires(!std::is_const_v<Scalar>) {
    return {data, rows, columns, stride};
  }

  Scalar* column(int index) const { return data + static_cast<std::ptrdiff_t>(index) * stride; }
  Scalar& operator()(int row, int col) const { return column(col)[row]; }
  MatrixView RowBlock(int first, int count) const { return {data + first, count, columns, stride}; }
  MatrixView ColumnBlock(int first, int count) const {
    return {column(first), rows, count, stride};
  }
  bool dense() const { return stride == rows; }
  // All numbers, column by column; for dense views only.
  std::span<Scalar> values() const { return {data, static_cast<std::size_t>(rows) * columns}; }
};

// Allocator of AlignedVector, whose first element starts a cache line for the SIMD passes.
template <typename T>
struct CacheLineAllocator {
  using value_type = T;
  CacheLineAllocator() = default;
  template <typename U>
  CacheLineAllocator(const CacheLineAllocator<U>&) {}  // NOLINT: rebinding
  T* allocate(std::size_t n) {
    return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(64)));
  }
  void deallocate(T* p, std::size_t) { ::operator delete(p, std::align_val_t(64)); }
  bool operator==(const CacheLineAllocator&) const { return true; }
};

template <typename T>
using AlignedVector = std::vector<T, CacheLineAllocator<T>>;

// Owns rows x columns numbers, zero at first. Its size never changes; moving a buffer keeps views
// of its numbers valid.
template <typename Scalar>
class MatrixBuffer {
 public:
  MatrixBuffer() = default;
  MatrixBuffer(int rows, int columns)
      : rows_(rows), columns_(columns), values_(static_cast<std::size_t>(rows) * columns) {}

  int rows() const { return rows_; }
  int columns() const { return columns_; }
  MatrixView<Scalar> view() { return {values_.data(), rows_, columns_}; }
  MatrixView<const Scalar> view() const { return {values_.data(), rows_, columns_}; }
  // All numbers, column by column.
  std::span<Scalar> values() { return values_; }
  std::span<const Scalar> values() const { return values_; }
  // The first `columns` columns.
  MatrixView<Scalar> view(int columns) { return view().ColumnBlock(0, columns); }
  MatrixView<const Scalar> view(int columns) const { return view().ColumnBlock(0, columns); }

 private:
  int rows_ = 0;
  int columns_ = 0;
  AlignedVector<Scalar> values_;
};

}  // namespace b4mrl
