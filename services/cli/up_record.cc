// SPDX-License-Identifier: Apache-2.0
#include "services/cli/up_record.h"

#include <unistd.h>

#include "services/core/clock.h"
#include "services/core/log.h"

namespace etude::cli {

Result<UpRecord> UpRecord::Begin(const Path& out, std::uint32_t domain, const std::map<std::string, Path>& folders,
                                 const std::string& address) {
  UpRecord record;
  record.file_ = out / "up.json";
  OrderedJson places = OrderedJson::object();
  for (const auto& [name, folder] : folders)
    places[name] = std::filesystem::absolute(folder).lexically_normal().string();
  record.json_ = {{"pids", {{"up", ::getpid()}}}, {"domain", domain}, {"folders", std::move(places)},
                  {"address", address},           {"phase", "begin"}, {"goal", ""},
                  {"started", WallSeconds()},     {"ended", nullptr}, {"exit", nullptr}};
  ETUDE_RETURN_IF_ERROR(record.Write());
  return record;
}

Status UpRecord::Write() const { return WriteFileAtomically(file_, JsonText(json_, 1) + "\n"); }

void UpRecord::WriteOrWarn() const {
  if (const Status written = Write(); !written) Log().warn("{}", written.error().message);
}

void UpRecord::SetChildren(const std::map<std::string, pid_t>& children) {
  if (children == children_) return;
  children_ = children;
  json_["pids"] = {{"up", ::getpid()}};
  for (const auto& [name, pid] : children) json_["pids"][name] = pid;
  WriteOrWarn();
}

void UpRecord::SetAddress(const std::string& address) {
  json_["address"] = address;
  WriteOrWarn();
}

void UpRecord::SetPhase(const std::string& phase, const std::string& goal) {
  json_["phase"] = phase;
  json_["goal"] = goal;
  WriteOrWarn();
}

void UpRecord::End(int exit_code) {
  json_["phase"] = "ended";
  json_["goal"] = "";
  json_["ended"] = WallSeconds();
  json_["exit"] = exit_code;
  WriteOrWarn();
}

}  // namespace etude::cli
