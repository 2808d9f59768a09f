// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/gateway.cc
#include "dashboard/server/gateway.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <thread>

#include "tests/dashboard/server/example_folders.h"
#include "tests/support/matchers.h"

namespace etude::dashboard {
namespace gateway_test {

GatewayOptions Options(const Path& folder) {
  GatewayOptions options;
  options.dirs = {folder};
  options.port = 0;
  options.use_bus = false;
  options.cache = folder / "cache";
  return options;
}

unsigned StatusOf(std::uint16_t port, const std::string& address, const std::string& host = "") {
  namespace wire = boost::beast::http;
  boost::asio::io_context context;
  boost::asio::ip::tcp::socket socket(context);
  socket.connect({boost::asio::ip::make_address(address), port});
  wire::request<wire::empty_body> request(wire::verb::get, "/api/v1/home", 11);
  request.set(wire::field::host, host.empty() ? address : host);
  wire::write(socket, request);
  boost::beast::flat_buffer buffer;
  wire::response<wire::string_body> reply;
  wire::read(socket, buffer, reply);
  return reply.result_int();
}

TEST(Gateway, ServesFoldersAlone) {
  ExampleFolders lab;
  auto gateway = Gateway::Open(Options(lab.root()));
  ASSERT_THAT(gateway, IsOk());
  EXPECT_EQ((*gateway)->url(), "http://127.0.0.1:" + std::to_string((*gateway)->port()));
  std::thread serving([&] { (*gateway)->Run(); });

  namespace wire = boost::beast::http;
  boost::asio::io_context context;
  boost::asio::ip::tcp::socket socket(context);
  socket.connect({boost::asio::ip::address_v4::loopback(), (*gateway)->port()});
  wire::request<wire::empty_body> request(wire::verb::get, "/api/v1/home", 11);
  request.set(wire::field::host, "localhost");
  wire::write(socket, request);
  boost::beast::flat_buffer buffer;
  wire::response<wire::string_body> reply;
  wire::read(socket, buffer, reply);
  EXPECT_EQ(reply.result_int(), 200u);
  EXPECT_NE(reply.body().find("lab.run"), std::string::npos);

  (*gateway)->Stop();
  serving.join();
}

TEST(Gateway, AllAddressesAreShownAsOneThatABrowserOpens) {
  TemporaryFolder folder;
  auto options = Options(folder.path());
  options.token_file = folder / "token";
  options.address = "0.0.0.0";
  const auto four = Gateway::Open(options);
  ASSERT_THAT(four, IsOk());
  EXPECT_EQ((*four)->url(), "http://127.0.0.1:" + std::to_string((*four)->port()));
  options.address = "::";
  auto both = Gateway::Open(options);
  if (!both) GTEST_SKIP() << "no IPv6: " << both.error().message;
  EXPECT_EQ((*both)->url(), "http://[::1]:" + std::to_string((*both)->port()));

  // an IPv4 client names its address as it knows it, and needs the token as any other
  std::thread serving([&] { (*both)->Run(); });
  EXPECT_EQ(StatusOf((*both)->port(), "127.0.0.2"), 401u);
  EXPECT_EQ(StatusOf((*both)->port(), "127.0.0.2", "127.0.0.3"), 403u);
  (*both)->Stop();
  serving.join();
}

// "NAME as it stands in the browser" has its port there: every request was refused
TEST(Gateway, AHostIsKnownAsABrowserShowsIt) {
  TemporaryFolder folder;
  auto options = Options(folder.path());
  options.hosts = {"http://lab-7"};
  EXPECT_THAT(Gateway::Open(options), HasCode(Code::kInvalidArgument));
  options.hosts = {"Lab-7:8080", "fd00::1"};
  auto gateway = Gateway::Open(options);
  ASSERT_THAT(gateway, IsOk());
  std::thread serving([&] { (*gateway)->Run(); });
  EXPECT_EQ(StatusOf((*gateway)->port(), "127.0.0.1", "lab-7:9"), 200u);
  EXPECT_EQ(StatusOf((*gateway)->port(), "127.0.0.1", "[fd00::1]:9"), 200u);
  EXPECT_EQ(StatusOf((*gateway)->port(), "127.0.0.1", "lab-8"), 403u);
  (*gateway)->Stop();
  serving.join();
}

TEST(Gateway, OtherMachinesNeedAToken) {
  TemporaryFolder folder;
  auto options = Options(folder.path());
  options.address = "0.0.0.0";
  EXPECT_THAT(Gateway::Open(options), MessageHas("--token-file"));
  options.token_file = folder / "token";
  ASSERT_THAT(Gateway::Open(options), IsOk());
  struct stat status {};
  ASSERT_EQ(::stat(options.token_file.c_str(), &status), 0) << "made";
  EXPECT_EQ(status.st_mode & 0777, 0600u);
  ASSERT_THAT(WriteFileAtomically(options.token_file, "short"), IsOk());
  EXPECT_THAT(Gateway::Open(options), HasCode(Code::kInvalidArgument));
}

}  // namespace gateway_test
}  // namespace etude::dashboard
