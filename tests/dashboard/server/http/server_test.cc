// SPDX-License-Identifier: Apache-2.0
// Tests dashboard/server/http/server.cc, connection.cc and socket_session.cc: over real sockets.
#include "dashboard/server/http/server.h"

#include <fcntl.h>
#include <gtest/gtest.h>

#include <atomic>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <future>
#include <stdexcept>
#include <thread>

#include "dashboard/server/http/answers.h"
#include "tests/support/matchers.h"
#include "tests/support/temporary_folder.h"

namespace etude::http {
namespace server_test {

namespace beast = boost::beast;
namespace net = boost::asio;
namespace wire = boost::beast::http;
using net::ip::tcp;
using Reply = wire::response<wire::string_body>;

// Keeps the socket that the server made.
class Keeper : public SocketClient {
 public:
  explicit Keeper(std::promise<void>& closed) : closed_(closed) {}
  void OnText(const std::string& text) override { heard += text; }
  void OnClosed() override { closed_.set_value(); }
  std::string heard;

 private:
  std::promise<void>& closed_;
};

class ServerTest : public testing::Test {
 protected:
  explicit ServerTest(std::chrono::milliseconds handle_time = {}) : handle_time_(handle_time) {}
  void SetUp() override {
    ASSERT_THAT(WriteFileAtomically(folder_ / "file.bin", std::string(300'000, 'a') + "end"), IsOk());
    Router router;
    router.Add("GET", "/file", Lane::kFiles, [this](const Request&) -> Result<Answer> {
      Answer answer;
      const int fd = ::open((folder_ / "file.bin").c_str(), O_RDONLY | O_CLOEXEC);
      answer.file = FileBody{std::make_shared<Descriptor>(fd), 300'003};
      answer.content_type = "application/octet-stream";
      answer.etag = "tag";
      return answer;
    });
    router.Add("GET", "/text", Lane::kEpisodes,
               [](const Request&) -> Result<Answer> { return BytesAnswer("hello", "text/plain"); });
    router.Add("GET", "/never", Lane::kEpisodes, [this](const Request&) -> Result<Answer> {
      release_.get_future().wait();
      return Answer{};
    });
    router.Add("GET", "/counted", Lane::kEpisodes, [this](const Request&) -> Result<Answer> {
      ++counted_;
      return Answer{};
    });
    router.Add("GET", "/alive", Lane::kAtOnce,
               [](const Request&) -> Result<Answer> { return BytesAnswer("ok", "text/plain"); });
    router.Add("GET", "/played", Lane::kPlay,
               [](const Request&) -> Result<Answer> { return BytesAnswer("ok", "text/plain"); });
    router.Add("POST", "/echo", Lane::kFiles,
               [](const Request& request) -> Result<Answer> { return BytesAnswer(request.body, "text/plain"); });
    service_ = std::make_unique<Service>(std::move(router), Security({}),
                                         [](const Request&) -> Result<Answer> { return Answer{}; });
    ServerOptions options;
    options.port = 0;
    if (handle_time_.count() > 0) options.handle_time = handle_time_;
    auto server = Server::Open(options, *service_, [this](const Request&, std::shared_ptr<Socket> socket) {
      opened_.set_value(std::move(socket));
      return std::make_shared<Keeper>(closed_);
    });
    ASSERT_THAT(server, IsOk());
    server_ = std::move(*server);
    thread_ = std::thread([this] { server_->Run(); });
  }
  void TearDown() override {
    server_->Stop();
    thread_.join();
    opened_ = {};  // a socket must not outlive its server
    server_.reset();
  }
  tcp::socket Connect() {
    tcp::socket socket(client_);
    socket.connect(tcp::endpoint(net::ip::address_v4::loopback(), server_->port()));
    return socket;
  }
  Reply Ask(tcp::socket& socket, wire::request<wire::string_body> request) {
    request.version(11);
    if (request[wire::field::host].empty()) request.set(wire::field::host, "localhost");
    request.prepare_payload();
    wire::write(socket, request);
    beast::flat_buffer buffer;
    wire::response_parser<wire::string_body> parser;
    parser.skip(request.method() == wire::verb::head);
    wire::read(socket, buffer, parser);
    return parser.release();
  }
  Reply Get(const std::string& target, const std::string& range = "", wire::verb verb = wire::verb::get) {
    auto socket = Connect();
    wire::request<wire::string_body> request(verb, target, 11);
    if (!range.empty()) request.set(wire::field::range, range);
    return Ask(socket, std::move(request));
  }

  const std::chrono::milliseconds handle_time_;  // 0: as it is by default
  std::atomic<int> counted_{0};
  TemporaryFolder folder_;
  std::promise<void> release_, closed_;
  std::unique_ptr<Service> service_;
  std::unique_ptr<Server> server_;
  std::promise<std::shared_ptr<Socket>> opened_;
  std::thread thread_;
  net::io_context client_;
};

TEST_F(ServerTest, FilesComeWholeAndInParts) {
  const Reply whole = Get("/file");
  EXPECT_EQ(whole.result_int(), 200u);
  EXPECT_EQ(whole.body().size(), 300'003u);
  EXPECT_EQ(whole[wire::field::accept_ranges], "bytes");
  const Reply part = Get("/file", "bytes=299999-");
  EXPECT_EQ(part.result_int(), 206u);
  EXPECT_EQ(part.body(), "aend");
  EXPECT_EQ(part[wire::field::content_range], "bytes 299999-300002/300003");
  EXPECT_EQ(Get("/file", "bytes=300003-").result_int(), 416u);
  const auto part_if = [&](const std::string& etag) {
    auto socket = Connect();
    wire::request<wire::string_body> request(wire::verb::get, "/file", 11);
    request.set(wire::field::range, "bytes=299999-");
    request.set(wire::field::if_range, etag);
    return Ask(socket, std::move(request));
  };
  EXPECT_EQ(part_if("\"of another file\"").result_int(), 200u) << "a part of this one would not fit";
  EXPECT_EQ(part_if("\"tag\"").result_int(), 206u);
  const Reply head = Get("/file", "", wire::verb::head);
  EXPECT_EQ(head.result_int(), 200u);
  EXPECT_EQ(head[wire::field::content_length], "300003");
}

TEST_F(ServerTest, OneConnectionServesManyRequests) {
  auto socket = Connect();
  for (int i = 0; i < 3; ++i) {
    const Reply reply = Ask(socket, {wire::verb::get, i == 1 ? "/file" : "/text", 11});
    EXPECT_EQ(reply.result_int(), 200u);
    EXPECT_EQ(reply["X-Content-Type-Options"], "nosniff");
    EXPECT_FALSE(reply["Content-Security-Policy"].empty());
  }
}

TEST_F(ServerTest, WhatIsTooLargeOrNoRequestIsRefused) {
  auto socket = Connect();
  wire::request<wire::string_body> request(wire::verb::post, "/echo", 11);
  request.body() = std::string(70'000, 'x');
  EXPECT_EQ(Ask(socket, request).result_int(), 413u);

  auto other = Connect();
  net::write(other, net::buffer(std::string("what is this\r\n\r\n")));
  beast::flat_buffer buffer;
  Reply reply;
  wire::read(other, buffer, reply);
  EXPECT_EQ(reply.result_int(), 400u);
  EXPECT_EQ(Get("/../etc/passwd").result_int(), 400u);
}

class ImpatientServerTest : public ServerTest {
 protected:
  ImpatientServerTest() : ServerTest(std::chrono::milliseconds(300)) {}
};

TEST_F(ImpatientServerTest, AnAnswerThatTakesTooLongIsGivenUp) {
  EXPECT_EQ(Get("/never").result_int(), 504u);
  EXPECT_EQ(Get("/counted").result_int(), 504u) << "it waits behind the first";
  release_.set_value();
  // in the same lane, so behind both
  std::promise<void> behind;
  server_->InLane(Lane::kEpisodes, [&] { behind.set_value(); });
  behind.get_future().wait();
  EXPECT_EQ(counted_, 0) << "nobody waits for it any more";
}

TEST_F(ServerTest, WorkThatThrowsDoesNotEndTheServer) {
  for (const Lane lane : {Lane::kFiles, Lane::kEpisodes, Lane::kBus, Lane::kPlay, Lane::kAtOnce}) {
    server_->InLane(lane, [] { throw std::runtime_error("a bug"); });
    std::promise<void> after;
    server_->InLane(lane, [&] { after.set_value(); });
    EXPECT_EQ(after.get_future().wait_for(std::chrono::seconds(10)), std::future_status::ready);
  }
}

// before, a Stop waited behind pictures that were rendered, and a probe behind folders that were read
TEST_F(ServerTest, CommandsAndProbesWaitBehindNobodyElse) {
  std::promise<void> done;
  const std::shared_future<void> until = done.get_future().share();
  for (const Lane lane : {Lane::kFiles, Lane::kEpisodes, Lane::kBus})
    for (int thread = 0; thread < 2; ++thread) server_->InLane(lane, [until] { until.wait(); });
  EXPECT_EQ(Get("/played").result_int(), 200u);
  EXPECT_EQ(Get("/alive").result_int(), 200u);
  done.set_value();
}

TEST_F(ServerTest, HostsOfOtherNamesAreRefused) {
  auto socket = Connect();
  wire::request<wire::string_body> request(wire::verb::get, "/text", 11);
  request.set(wire::field::host, "evil.example");
  EXPECT_EQ(Ask(socket, request).result_int(), 403u);
}

using WebSocket = beast::websocket::stream<tcp::socket>;

TEST_F(ServerTest, ASlowReaderIsBoundedAndGetsTheNewest) {
  WebSocket browser(Connect());
  browser.handshake("localhost", "/api/v1/live");
  const auto socket = opened_.get_future().get();
  constexpr int kMessages = 200;
  const std::string filler(1 << 20, 'x');
  for (int i = 1; i <= kMessages; ++i) {
    socket->Send("home", std::to_string(i) + " " + filler);
    ASSERT_LE(socket->waiting_bytes(), 4u << 20);
  }
  for (int i = 0; i < 20; ++i) socket->Send("other" + std::to_string(i), filler);
  EXPECT_LE(socket->waiting_bytes(), 4u << 20) << "however many slots";

  browser.read_message_max(8 << 20);
  int last = 0, received = 0;
  while (last < kMessages) {
    beast::flat_buffer buffer;
    browser.read(buffer);
    const std::string text = beast::buffers_to_string(buffer.data());
    if (text[0] == 'x') continue;
    EXPECT_GT(std::stoi(text), last) << "in order";
    last = std::stoi(text);
    ++received;
  }
  EXPECT_LT(received, kMessages) << "those in between were replaced";
}

TEST_F(ServerTest, OtherPagesOpenNoWebSocket) {
  WebSocket browser(Connect());
  browser.set_option(beast::websocket::stream_base::decorator(
      [](beast::websocket::request_type& request) { request.set(wire::field::origin, "http://evil.example"); }));
  beast::error_code error;
  browser.handshake("localhost", "/api/v1/live", error);
  EXPECT_EQ(error, beast::websocket::error::upgrade_declined);
}

TEST_F(ServerTest, ABrowserThatLeavesIsTold) {
  {
    WebSocket browser(Connect());
    browser.handshake("localhost", "/api/v1/live");
    browser.write(net::buffer(std::string("{}")));
  }
  EXPECT_EQ(closed_.get_future().wait_for(std::chrono::seconds(10)), std::future_status::ready);
}

TEST(Server, SaysThatAPortIsTaken) {
  Service service(Router{}, Security({}), [](const Request&) -> Result<Answer> { return Answer{}; });
  const SocketFactory none = [](const Request&, std::shared_ptr<Socket>) { return nullptr; };
  ServerOptions options;
  options.port = 0;
  const auto first = Server::Open(options, service, none);
  ASSERT_THAT(first, IsOk());
  options.port = (*first)->port();
  EXPECT_THAT(Server::Open(options, service, none), MessageHas("--port"));
  options.address = "not an address";
  EXPECT_THAT(Server::Open(options, service, none), HasCode(Code::kInvalidArgument));
}

}  // namespace server_test
}  // namespace etude::http
