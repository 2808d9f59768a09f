// SPDX-License-Identifier: Apache-2.0
// Telling a live campaign's collector something, and its answer.
#pragma once

#include <chrono>
#include <string>

#include "services/bus/directory.h"
#include "services/bus/topic.h"
#include "services/core/result.h"

namespace etude::cli {

/// A collector that was told something, and what it answered.
struct Told {
  bus::Presence collector;
  bus::Reader<bus::CampaignStatus> statuses;
  bus::CampaignStatus status;
};

/// Says it until the collector's next status answers it, for at most `patience`.
/// @param word     what it is told, for errors: "pause"
/// @param message  its action and what belongs to it; who asks and whom is filled in
/// @error kUnavailable: it does not listen, or does not answer; kInvalidArgument: it refuses, with its words
Result<Told> TellCollector(const bus::Participant& participant, const bus::Presence& collector, const std::string& word,
                           bus::CampaignControl message, std::chrono::seconds patience = std::chrono::seconds(10));

}  // namespace etude::cli
