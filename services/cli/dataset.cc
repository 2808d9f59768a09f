// SPDX-License-Identifier: Apache-2.0
// `etude dataset info|verify|hash|sheet`; dataset_edit.h has the rest.
#include "services/store/dataset.h"

#include <fmt/format.h>

#include "services/cli/command_line.h"
#include "services/cli/dataset_edit.h"
#include "services/cli/filmstrip.h"
#include "services/core/command_table.h"
#include "services/core/config.h"
#include "services/store/edit.h"

namespace etude::cli {
namespace {

Status Info(const std::string& dataset, bool as_json) {
  ETUDE_ASSIGN_OR_RETURN(const OrderedJson info, store::DatasetInfo(dataset));
  fmt::print("{}", as_json ? JsonText(info, 1) + "\n" : ToYaml(info));
  return {};
}

// [{path, reason}]
template <class List>
OrderedJson Files(const List& files) {
  OrderedJson list = OrderedJson::array();
  for (const auto& file : files) list.push_back({{"path", file.path.string()}, {"reason", file.reason}});
  return list;
}

Status Verify(const std::string& dataset, bool keep, bool as_json) {
  ETUDE_ASSIGN_OR_RETURN(const auto report,
                         store::Verify(dataset, keep ? store::Quarantine::kNo : store::Quarantine::kYes));
  if (as_json) {
    OrderedJson json{{"good", report.good}, {"bad", Files(report.bad)}, {"unread", Files(report.unread)}};
    if (!report.moved) json["not_moved"] = report.moved.error().message;
    if (!report.refreshed) json["not_refreshed"] = report.refreshed.error().message;
    fmt::print("{}\n", JsonText(json, 1));
  } else {
    for (const auto& bad : report.bad) fmt::print("bad     {}: {}\n", bad.path.string(), bad.reason);
    for (const auto& unread : report.unread) fmt::print("unread  {}: {}\n", unread.path.string(), unread.reason);
    fmt::print("{} good, {} bad, {} could not be read\n", report.good, report.bad.size(), report.unread.size());
  }
  ETUDE_RETURN_IF_ERROR(report.moved);
  ETUDE_RETURN_IF_ERROR(report.refreshed);
  if (report.bad.empty() && report.unread.empty()) return {};
  if (report.bad.empty())
    return Fail(Code::kUnavailable,
                fmt::format("{} episodes could not be read, and were left where they are; mend what "
                            "is said above and verify again",
                            report.unread.size()));
  return Fail(Code::kCorrupt,
              fmt::format("{} of {} episodes are damaged{}", report.bad.size(), report.good + report.bad.size(),
                          keep                             ? "; without --keep they are moved to quarantine/"
                          : store::CanBeMadeAgain(dataset) ? ", moved to quarantine/; `etude collect` makes them again"
                                                           : ", moved to quarantine/"));
}

Status Hash(const std::string& dataset) {
  ETUDE_ASSIGN_OR_RETURN(const std::string hash, store::HashDataset(dataset));
  fmt::print("{}\n", hash);
  return {};
}

Status WriteSheet(const std::string& dataset, const std::string& out, const FilmstripOptions& options) {
  ETUDE_RETURN_IF_ERROR(WriteFilmstrips(dataset, out, options));
  fmt::print("{}\n", out);
  return {};
}

}  // namespace

void AddDataset(CLI::App& app, Body& body) {
  auto* command = AddGroup(app, "dataset", "look at a dataset, verify it, take it apart, export it");
  auto dataset = std::make_shared<std::string>();
  auto as_json = std::make_shared<bool>(false), keep = std::make_shared<bool>(false);
  const auto add = [&](const char* name, const char* description) {
    auto* sub = command->add_subcommand(name, description);
    sub->add_option("dataset", *dataset, "dataset folder")->required();
    return sub;
  };
  auto* info = add("info", "episodes per task, target and split, steps, frames, bytes, failures, features");
  info->add_flag("--json", *as_json, "as JSON");
  info->callback([=, &body] { body = [=] { return Info(*dataset, *as_json); }; });
  auto* verify = add("verify", "read every byte; damaged episodes are moved to quarantine/");
  verify->add_flag("--keep", *keep, "only report, move nothing");
  verify->add_flag("--json", *as_json, "as JSON: {good, bad: [{path, reason}], unread}");
  verify->callback([=, &body] { body = [=] { return Verify(*dataset, *keep, *as_json); }; });
  auto* hash = add("hash", "SHA-256 of the content, the same whoever collected it");
  hash->callback([=, &body] { body = [=] { return Hash(*dataset); }; });
  auto out = std::make_shared<std::string>("sheet.png");
  auto options = std::make_shared<FilmstripOptions>();
  auto* sheet = add("sheet", "a picture to look at: episodes as filmstrips");
  sheet->add_option("--out", *out, "picture, .png or .jpg; moving, side by side: .webp or .mp4")
      ->check(EndsWith({".png", ".jpg", ".webp", ".mp4"}))
      ->capture_default_str();
  sheet->add_option("--index", options->indices, "rows: these episodes, in this order")->delimiter(',');
  sheet->add_option("--episodes", options->episodes, "else so many rows: the first ones")->capture_default_str();
  sheet->add_option("--frames", options->frames, "columns")->capture_default_str();
  sheet->callback([=, &body] { body = [=] { return WriteSheet(*dataset, *out, *options); }; });
  AddDatasetEdit(*command, body);
}

}  // namespace etude::cli
