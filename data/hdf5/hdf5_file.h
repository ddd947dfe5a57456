// HDF5 behind two small classes; nothing else in the project includes hdf5.h.
//
// Hdf5Reader treats the file as hostile. HDF5 1.10.8 has known crashes on crafted files, so what
// comes from outside is only opened inside the importer's sandbox; beyond that the reader follows
// hard links only, loads no plugins, and refuses external and virtual storage, variable-length,
// reference, compound and opaque types, filters other than deflate, shuffle and fletcher32, and any
// declared size above proto/base/limits.h or beyond what the stored bytes (holes not counted) can
// inflate to, before it allocates. The library reads through this project's own file driver, so it
// never opens a path by itself. ReadText alone takes a variable-length string, without the library.
//
// Hdf5Writer makes a file that appears complete or not at all (see atomic_file.h). Equal calls give
// equal bytes: no timestamps, and buffering makes the layout independent of how appends are split.
// Every dataset carries fletcher32 checksums.
//
// Paths inside a file are "/"-separated ("metadata/policy/fc0/weight"). Arrays are row-major with
// one or two dimensions; a one-dimensional array and an (N, 1) array both have width 1. Thread
// rule: an object belongs to one thread. The HDF5 library locks itself globally. Errors: kIoError
// (open, full disk), kDataLoss (not HDF5, truncated, checksum), kUnknownName (no such dataset),
// kInvalidArgument (wrong type, rank or size), kLimitExceeded (declared size).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// Of one array that ReadFloats takes: what is written to be read by it must not be longer.
inline constexpr uint64_t kMaxReadFloats = 80ull << 20;

enum class Hdf5Type { kFloat32, kFloat64, kInteger, kBool, kString };
std::string_view Hdf5TypeName(Hdf5Type type);

// An open dataset; keep it while reading consecutive rows, because it holds the decompressed chunk.
// It may outlive the reader that opened it.
class Hdf5Column {
 public:
  Hdf5Column(Hdf5Column&&) noexcept;
  Hdf5Column& operator=(Hdf5Column&&) noexcept;
  ~Hdf5Column();

  const std::string& path() const;
  Hdf5Type type() const;
  // As stored: empty for a scalar, else one or two extents.
  const std::vector<uint64_t>& shape() const;
  uint64_t rows() const;   // 1 for a scalar
  uint64_t width() const;  // elements of a row
  // The row count by which consecutive reads touch every chunk once.
  uint64_t block_rows() const;

  // Rows [first_row, first_row + out.size() / width()), converted: float64 to float32 rounds,
  // integers and booleans become numbers. For uint8_t the column must be integer or bool; every
  // nonzero is 1.
  Status Read(uint64_t first_row, std::span<float> out) const;
  Status Read(uint64_t first_row, std::span<double> out) const;
  Status ReadFlags(uint64_t first_row, std::span<uint8_t> out) const;

 private:
  friend class Hdf5Reader;
  struct State;
  explicit Hdf5Column(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

class Hdf5Reader {
 public:
  static Result<Hdf5Reader> Open(const std::string& path);
  Hdf5Reader(Hdf5Reader&&) noexcept;
  Hdf5Reader& operator=(Hdf5Reader&&) noexcept;
  ~Hdf5Reader();

  // False also for a path that goes over anything but hard links.
  bool Exists(std::string_view path) const;
  Result<Hdf5Column> OpenColumn(std::string_view path) const;
  // Whole small datasets (at most kMaxReadFloats elements).
  Result<std::vector<float>> ReadFloats(std::string_view path) const;
  // A scalar number, or the only element of an array.
  Result<double> ReadNumber(std::string_view path) const;
  // A scalar fixed-length string of at most 64 KiB, without its padding.
  Result<std::string> ReadString(std::string_view path) const;
  // The same, or a variable-length string as h5py writes them, of at most 64 KiB too.
  Result<std::string> ReadText(std::string_view path) const;

 private:
  struct State;
  explicit Hdf5Reader(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

struct Hdf5ColumnOptions {
  Hdf5Type type = Hdf5Type::kFloat32;  // not kString
  uint64_t width = 0;                  // 0: one-dimensional
  uint64_t chunk_rows = 8192;
  int compression_level = 1;  // deflate 1..9 after shuffle; 0 stores plainly
};

class Hdf5Writer {
 public:
  using ColumnId = size_t;

  static Result<Hdf5Writer> Create(const std::string& path);
  Hdf5Writer(Hdf5Writer&&) noexcept;
  Hdf5Writer& operator=(Hdf5Writer&&) noexcept;
  ~Hdf5Writer();

  // A growing column; missing groups are created. Appends hold whole rows and must match the type
  // (bool and integer columns take uint8_t).
  Result<ColumnId> CreateColumn(std::string_view path, const Hdf5ColumnOptions& options);
  Status Append(ColumnId column, std::span<const float> values);
  Status Append(ColumnId column, std::span<const double> values);
  Status Append(ColumnId column, std::span<const uint8_t> values);

  // A small array of fixed shape (product of `shape` == values.size(), none of them 0).
  Status WriteArray(std::string_view path, std::span<const float> values,
                    std::span<const uint64_t> shape);
  Status WriteString(std::string_view path, std::string_view text);
  Status WriteInteger(std::string_view path, int64_t value);
  Status WriteNumber(std::string_view path, double value);

  // Flushes, fsyncs and renames into place. After an error the file does not appear.
  Status Commit();

 private:
  struct State;
  explicit Hdf5Writer(std::unique_ptr<State> state);
  Status AppendBytes(ColumnId column, Hdf5Type given, std::span<const std::byte> bytes);
  std::unique_ptr<State> state_;
};

}  // namespace b4mrl
