// SPDX-License-Identifier: Apache-2.0
// `etude topic list|echo|hz`: the bus itself, for people.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <set>
#include <utility>

#include "services/bus/topology.h"
#include "services/cli/bus_watch.h"
#include "services/cli/command_line.h"
#include "services/core/clock.h"
#include "services/core/config.h"
#include "services/core/log.h"
#include "services/core/printable.h"
#include "services/core/stop.h"
#include "services/monitor/topics.h"

namespace etude::cli {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kMostPartitions = 64;  // that are read at once

struct TopicArguments {
  std::string topic, partition;
  bool as_json = false, bulk = false;
  std::uint64_t count = 0;
  double seconds = 5;
  BusArguments bus;
};

// ": a, b", or nothing where there are none.
std::string PeersText(const std::vector<bus::PeerEndpoint>& endpoints,
                      const std::map<std::string, std::string>& names) {
  std::set<std::string> peers;
  for (const auto& endpoint : endpoints) {
    const auto name = names.find(endpoint.participant);
    peers.insert(name == names.end() ? endpoint.participant.substr(0, 12) : name->second);
  }
  return fmt::format("{}{}", peers.empty() ? "" : ": ", fmt::join(peers, ", "));
}

// Who writes and reads, once every process of ours that writes has said who it is, which each does once a second; not
// for ever.
Result<std::vector<bus::PeerEndpoint>> NamedEndpoints(const bus::Participant& participant, BusWatch& watch) {
  constexpr int kMoreLooks = 8;
  const std::string own = bus::ParticipantId(participant);
  ETUDE_RETURN_IF_ERROR(watch.LookAround(1500ms));
  for (int look = 0;; ++look) {
    ETUDE_ASSIGN_OR_RETURN(auto endpoints, bus::Endpoints(participant));
    const auto names = monitor::PeerNames(watch.view().processes);
    const bool all = std::ranges::all_of(endpoints, [&](const bus::PeerEndpoint& one) {
      return !one.is_writer || !one.topic.starts_with("etude/") || one.participant == own ||
             names.contains(one.participant);
    });
    if (all || look == kMoreLooks || StopRequested()) return endpoints;
    ETUDE_RETURN_IF_ERROR(watch.LookAround(500ms));
  }
}

Status ListTopics(const TopicArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(auto watch, BusWatch::Open(participant));
  ETUDE_ASSIGN_OR_RETURN(const auto endpoints, NamedEndpoints(participant, watch));
  const auto names = monitor::PeerNames(watch.view().processes);
  const auto rows = monitor::TopicRows(endpoints, bus::ParticipantId(participant));
  OrderedJson all = OrderedJson::array();
  for (const auto& [topic, row] : rows) {
    all.push_back(monitor::TopicJson(topic, row, names));
    if (arguments.as_json) continue;
    const auto line = [](const std::string& text) { fmt::print("{}\n", Printable(text)); };
    line(topic);
    line(fmt::format("  type     {}", fmt::join(row.types, ", ")));
    line(fmt::format("  QoS      {}", fmt::join(row.qos, "; ")));
    line(fmt::format("  writers  {}{}", row.writers.size(), PeersText(row.writers, names)));
    line(fmt::format("  readers  {}{}", row.readers.size(), PeersText(row.readers, names)));
    for (const auto& problem : row.problems) line("  MISMATCH " + problem);
  }
  if (arguments.as_json) fmt::print("{}\n", JsonText(all, 1));
  if (!arguments.as_json && rows.empty()) fmt::print("nobody else is on domain {}\n", participant.domain());
  return {};
}

// The partitions in which somebody writes the topic now.
Result<std::set<std::string>> Written(const bus::Participant& participant, const TopicArguments& arguments) {
  if (!arguments.partition.empty()) return std::set<std::string>{arguments.partition};
  ETUDE_ASSIGN_OR_RETURN(const auto endpoints, bus::Endpoints(participant));
  return monitor::WrittenPartitions(endpoints, arguments.topic);
}

Status CheckTopic(const TopicArguments& arguments) {
  const auto known = bus::KnownTopics();
  if (std::ranges::count(known, arguments.topic) == 0)
    return Fail(Code::kInvalidArgument, "topic " + NotKnown(arguments.topic, known));
  if (monitor::IsBulk(arguments.topic) && !arguments.bulk)
    return Fail(Code::kInvalidArgument,
                fmt::format("topic '{}' carries episodes: their senders would send every byte here, too, and wait for "
                            "it; `etude topic hz {}` counts them, --bulk reads them all the same",
                            arguments.topic, arguments.topic));
  return {};
}

Status Echo(const TopicArguments& arguments) {
  ETUDE_RETURN_IF_ERROR(CheckTopic(arguments));
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  std::map<std::string, std::unique_ptr<bus::Echo>> readers;  // by partition
  std::set<std::string> refused;
  bool told_of_most = false;
  std::uint64_t printed = 0;
  for (int round = 0; !StopRequested() && std::ferror(stdout) == 0; ++round) {
    if (round % 10 == 0) {  // a new run or campaign has a partition of its own
      ETUDE_ASSIGN_OR_RETURN(const auto partitions, Written(participant, arguments));
      std::erase_if(readers, [&](const auto& item) { return std::ranges::count(partitions, item.first) == 0; });
      for (const auto& partition : partitions) {
        if (readers.contains(partition)) continue;
        if (readers.size() >= kMostPartitions) {
          if (!std::exchange(told_of_most, true))
            Log().warn("{} partitions are written, and {} of them are read; --partition chooses one", partitions.size(),
                       kMostPartitions);
          break;
        }
        auto reader = bus::Echo::Open(participant, arguments.topic, partition);
        // an identity of one campaign or run may not read the others, and a stranger may call one anything
        if (!reader &&
            (participant.secured() || (arguments.partition.empty() && reader.error().code == Code::kInvalidArgument))) {
          if (refused.insert(partition).second)
            Log().warn("'{}' is left out: {}", Printable(partition), reader.error().message);
          continue;
        }
        ETUDE_ASSIGN_OR_RETURN(readers[partition], std::move(reader));
      }
    }
    for (auto& [partition, reader] : readers)
      for (const auto& message : reader->Take()) {
        fmt::print("{}\n", JsonText(message));
        if (++printed == arguments.count) return {};
      }
    std::fflush(stdout);
    WaitForStop(100ms);
  }
  return {};
}

Status Hz(const TopicArguments& arguments) {
  ETUDE_ASSIGN_OR_RETURN(const auto participant, arguments.bus.Open({security::Role::kGateway}));
  ETUDE_ASSIGN_OR_RETURN(auto watch, BusWatch::Open(participant));
  ETUDE_RETURN_IF_ERROR(watch.LookAround(1500ms));
  monitor::TopicRates rates;
  // in a star hosts find each other within seconds
  const auto end =
      MonotonicClock::now() + std::chrono::milliseconds(static_cast<std::int64_t>(arguments.seconds * 1000));
  do {
    rates.Hear(watch.view().processes);
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - MonotonicClock::now());
    ETUDE_RETURN_IF_ERROR(watch.LookAround(std::clamp(left, 1ms, 500ms)));
  } while (MonotonicClock::now() < end && !StopRequested());
  OrderedJson all = OrderedJson::array();
  for (const auto& [topic, rate] : rates.End(watch.view().processes)) {
    if (!arguments.topic.empty() && topic != arguments.topic) continue;
    all.push_back({{"topic", topic},
                   {"samples_per_second", rate.samples_per_second},
                   {"bytes_per_second", rate.bytes_per_second},
                   {"writers", rate.writers}});
    if (arguments.as_json) continue;
    fmt::print("{:<36} {:>9.1f}/s {:>11.1f} kB/s  {} writing process{}\n", Printable(topic), rate.samples_per_second,
               rate.bytes_per_second / 1000, rate.writers, rate.writers == 1 ? "" : "es");
  }
  if (arguments.as_json)
    fmt::print("{}\n", JsonText(all, 1));
  else if (all.empty())
    fmt::print("no process on domain {} counts {}\n", participant.domain(),
               arguments.topic.empty() ? "any topic" : "topic '" + arguments.topic + "'");
  return {};
}

}  // namespace

void AddTopic(CLI::App& app, Body& body) {
  auto* command = app.add_subcommand("topic", "the bus: topics with types, QoS and peers; messages; rates");
  command->require_subcommand(1);
  auto arguments = std::make_shared<TopicArguments>();
  auto* list = command->add_subcommand("list", "every topic: type, QoS, who writes and who reads it");
  list->add_flag("--json", arguments->as_json, "as JSON");
  arguments->bus.Add(*list);
  list->callback([=, &body] { body = [=] { return ListTopics(*arguments); }; });

  auto* echo = command->add_subcommand("echo", "messages of a topic, a line of JSON each");
  echo->add_option("topic", arguments->topic, "e.g. etude/campaign/status")->required();
  echo->add_option("--partition", arguments->partition,
                   "NAME/ID of a campaign or a run (default: all that are written)");
  echo->add_option("--count", arguments->count, "so many messages, then end");
  echo->add_flag("--bulk", arguments->bulk, "also topics that carry episodes");
  arguments->bus.Add(*echo);
  echo->callback([=, &body] { body = [=] { return Echo(*arguments); }; });

  auto* hz = command->add_subcommand("hz", "messages and bytes a second, as their writers count them");
  hz->add_option("topic", arguments->topic, "only this one");
  hz->add_option("--seconds", arguments->seconds, "to count for")
      ->check(CLI::Range(1.0, 3600.0))
      ->capture_default_str();
  hz->add_flag("--json", arguments->as_json, "as JSON, in messages and bytes a second");
  arguments->bus.Add(*hz);
  hz->callback([=, &body] { body = [=] { return Hz(*arguments); }; });
}

}  // namespace etude::cli
