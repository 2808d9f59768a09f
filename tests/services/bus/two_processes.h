// SPDX-License-Identifier: Apache-2.0
// Two participants in one process that meet over the network, as those of two processes do: each has a
// DDS domain of its own here, and both say they are `domain` outside.
#pragma once

#include <gtest/gtest.h>

#include <numeric>
#include <string>
#include <vector>

#include "services/bus/participant.h"
#include "services/core/file.h"

namespace etude::bus {

/// deploy/dds/local.xml with more settings in its Discovery and Internal sections.
inline std::string LocalProfileWith(const std::string& discovery, const std::string& internal = {}) {
  auto text = ReadTextFile("deploy/dds/local.xml");
  EXPECT_TRUE(text) << "run the test in the root of the sources";
  std::string profile = text.value_or("");
  profile.insert(profile.find("</Discovery>"), discovery);
  profile.insert(profile.find("</Internal>"), internal);
  return profile;
}

struct TwoProcesses {
  Participant a;
  Participant b;
};

/// `loss_per_mille` of the packets are lost, in both directions.
inline TwoProcesses OpenTwo(std::uint32_t domain, int loss_per_mille = 0) {
  const std::string outside = "<ExternalDomainId>" + std::to_string(domain) + "</ExternalDomainId>";
  const std::string loss = "<Test><XmitLossiness>" + std::to_string(loss_per_mille) + "</XmitLossiness></Test>";
  const std::string profile = LocalProfileWith(outside, loss_per_mille > 0 ? loss : "");
  auto a = Participant::Open({150, profile});
  auto b = Participant::Open({151, profile});
  EXPECT_TRUE(a) << a.error().message;
  EXPECT_TRUE(b) << b.error().message;
  return {std::move(*a), std::move(*b)};
}

inline std::vector<std::uint8_t> MakeBytes(std::size_t size, std::uint32_t seed) {
  std::vector<std::uint8_t> bytes(size);
  std::uint32_t state = seed * 2654435761u + 1;
  for (auto& byte : bytes) {
    state = state * 1664525u + 1013904223u;
    byte = static_cast<std::uint8_t>(state >> 24);
  }
  return bytes;
}

}  // namespace etude::bus
