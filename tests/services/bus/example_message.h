// SPDX-License-Identifier: Apache-2.0
// A message of every type with another value in each field, and its fields as texts.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <type_traits>
#include <vector>

#include "services/bus/wire.h"

namespace etude::bus {

// Calls Visitor::See(name, field) for every field of a message, whatever its bounds and its place on the wire.
template <class Visitor>
class EachField {
 public:
  template <class T, class... Rest>
  void operator()(const char* name, T& field, Rest&...) {
    static_cast<Visitor&>(*this).See(name, field);
  }
  template <class T, class W, class B>
  void operator()(const char* name, T& field, W&, B) {
    static_cast<Visitor&>(*this).See(name, field);
  }
};

// Gives each field a value of its own, through the same field lists that the wire uses.
class Filler : public EachField<Filler> {
 public:
  void See(const char* name, std::string& field) { field = std::string(name) + std::to_string(++n_); }
  void See(const char*, bool& field) { field = true; }
  template <class T>
  requires std::is_arithmetic_v<T>
  void See(const char*, T& field) { field = static_cast<T>(++n_ * 1000003); }
  template <class E>
  requires std::is_enum_v<E>
  void See(const char*, E& field) { field = static_cast<E>(2); }
  template <class T>
  void See(const char*, std::vector<T>& field) {
    for (int i = 0; i < 5; ++i) field.push_back(static_cast<T>(++n_));
  }
  int n_ = 0;
};

// Compares two messages by what would go on the wire.
class Lister : public EachField<Lister> {
 public:
  std::vector<std::string> fields;

  template <class T>
  void See(const char* name, const T& field) {
    std::string text = std::string(name) + "=";
    if constexpr (std::is_same_v<T, std::string>) {
      text += field;
    } else if constexpr (std::is_enum_v<T>) {
      text += std::to_string(static_cast<int>(field));
    } else if constexpr (std::is_arithmetic_v<T>) {
      text += std::to_string(field);
    } else {
      for (const auto item : field) text += std::to_string(item) + ",";
    }
    fields.push_back(text);
  }
};

template <class Message>
std::vector<std::string> List(Message message) {
  typename Traits<Message>::Wire wire{};
  Lister lister;
  Fields(lister, message, wire);
  return lister.fields;
}

template <class Message>
Message MakeMessage() {
  Message message;
  typename Traits<Message>::Wire wire{};
  Filler filler;
  Fields(filler, message, wire);
  if constexpr (std::is_same_v<Message, Observation>) {
    message.width = 3;
    message.height = 2;
    message.image.resize(18, 7);
    message.intrinsics.resize(4);
    message.camera_pose.resize(7, 1);
  } else if constexpr (std::is_same_v<Message, Insight>) {
    message.view.resize(4);
  } else if constexpr (std::is_same_v<Message, BlobManifest>) {
    message.size = 5;
    message.chunk_size = 4;
    message.chunk_count = 2;
    message.sha256.assign(32, 9);
  }
  return message;
}

/// For TYPED_TEST_SUITE.
using EveryMessageType =
    testing::Types<Presence, CampaignAnnouncement, WorkRequest, Lease, WorkerStatus, AttemptReport, ValidationErrors,
                   CampaignStatus, CampaignControl, BlobManifest, BlobChunk, BlobAck, Observation, Action, InsightWish,
                   Insight, PolicyStatus, PlayCommand, PlayState, PlayFrame, ProcessStatus, ProcessEvent, TrainStatus>;

}  // namespace etude::bus
