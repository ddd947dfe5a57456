// Internal to hdf5_*.cc: scoped HDF5 identifiers and the project's file driver.
//
// The driver makes the HDF5 library use a file descriptor that this project opened. It reports no
// failed write to the library, because HDF5 1.10 crashes at exit when it cannot flush its data;
// instead it remembers the first error and drops later writes. The file's owner checks
// `error_number` before it renames the file into place.
#pragma once

#include <hdf5.h>

#include <cstdint>
#include <utility>

namespace b4mrl {

class Hdf5Handle {
 public:
  using Closer = herr_t (*)(hid_t);
  Hdf5Handle() = default;
  Hdf5Handle(hid_t id, Closer closer) : id_(id), closer_(closer) {}
  Hdf5Handle(Hdf5Handle&& other) noexcept
      : id_(std::exchange(other.id_, -1)), closer_(other.closer_) {}
  Hdf5Handle& operator=(Hdf5Handle&& other) noexcept {
    if (this != &other) {
      Reset();
      id_ = std::exchange(other.id_, -1);
      closer_ = other.closer_;
    }
    return *this;
  }
  ~Hdf5Handle() { Reset(); }

  hid_t get() const { return id_; }
  bool valid() const { return id_ >= 0; }
  void Reset() {
    if (id_ >= 0) closer_(id_);
    id_ = -1;
  }

 private:
  hid_t id_ = -1;
  Closer closer_ = nullptr;
};

// Shared by the driver and the object that owns the file; outlives every handle into the file.
struct Hdf5DriverState {
  int fd = -1;
  bool writable = false;
  uint64_t file_bytes = 0;
  int error_number = 0;  // errno of the first failure
};

// Silences HDF5's error stack in the calling thread; the process's first call also forbids plugins
// and registers the driver.
void InitialiseHdf5();
// A file access list that makes H5Fopen and H5Fcreate use `state` and ignore the file's name.
Hdf5Handle Hdf5DriverAccess(Hdf5DriverState* state);

}  // namespace b4mrl
