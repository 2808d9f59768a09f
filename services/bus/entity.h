// SPDX-License-Identifier: Apache-2.0
// Owners of Cyclone DDS handles. Internal to services/bus.
#pragma once

#include <dds/dds.h>

#include <memory>
#include <string_view>
#include <utility>

#include "services/core/result.h"

namespace etude::bus {

/// Owns one DDS entity; 0 = none.
class Entity {
 public:
  Entity() = default;
  explicit Entity(dds_entity_t handle) : handle_(handle) {}
  Entity(Entity&& other) noexcept : handle_(std::exchange(other.handle_, 0)) {}
  Entity& operator=(Entity&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Entity() {
    if (handle_ > 0) dds_delete(handle_);
  }
  dds_entity_t get() const { return handle_; }

 private:
  dds_entity_t handle_ = 0;
};

/// Turns a DDS return code into an Error that says what was attempted.
Error DdsError(dds_return_t code, std::string_view attempted);

inline Result<Entity> CheckEntity(dds_entity_t handle, std::string_view attempted) {
  if (handle < 0) return Fail(DdsError(handle, attempted));
  return Entity(handle);
}

struct DeleteQos {
  void operator()(dds_qos_t* qos) const { dds_delete_qos(qos); }
};
using Qos = std::unique_ptr<dds_qos_t, DeleteQos>;

}  // namespace etude::bus
