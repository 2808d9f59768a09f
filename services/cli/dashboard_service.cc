// SPDX-License-Identifier: Apache-2.0
#include "services/cli/dashboard_service.h"

#include <filesystem>
#include <fstream>

namespace etude::cli {
namespace {

// What the gateway prints once it listens.
constexpr std::string_view kSays = "dashboard  http";

// The last such line behind `begin`; "": none.
std::string AddressIn(const Path& log, std::uint64_t begin) {
  std::ifstream stream(log, std::ios::binary);
  stream.seekg(static_cast<std::streamoff>(begin));
  std::string address;
  for (std::string line; std::getline(stream, line) && !stream.eof();)
    if (line.starts_with(kSays)) address = line.substr(line.find("http"));
  return address;
}

}  // namespace

Result<DashboardService> DashboardService::Start(const DashboardOptions& options) {
  ServiceOptions service;
  service.program = options.program;
  service.arguments = {"--dir", options.out.string(), "--port", std::to_string(options.port)};
  const auto flags = options.bus.Flags(security::Role::kGateway);
  service.arguments.insert(service.arguments.end(), flags.begin(), flags.end());
  service.environment = options.bus.Environment();
  service.log = options.out / "logs" / "dashboard.log";
  std::error_code error;
  const auto size = std::filesystem::file_size(service.log, error);
  ETUDE_ASSIGN_OR_RETURN(auto started, Service::Start(service));
  return DashboardService(std::move(started), service.log, error ? 0 : size);
}

Status DashboardService::Supervise() {
  ETUDE_RETURN_IF_ERROR(service_.Supervise());
  if (service_.done()) return Fail(Code::kUnavailable, "etude-gateway ended; see " + log_.string());
  if (!service_.pid() && !address_.empty()) {  // it died and is started again, perhaps on another port
    address_.clear();
    std::error_code error;
    const auto size = std::filesystem::file_size(log_, error);
    if (!error) read_ = size;
  }
  if (address_.empty()) address_ = AddressIn(log_, read_);
  return {};
}

}  // namespace etude::cli
