// SPDX-License-Identifier: Apache-2.0
// Times and pictures of an mp4, by libav.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "services/core/file.h"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
}

namespace etude::video {

struct VideoContent {
  int width = 0, height = 0;
  std::vector<double> times;       ///< s, of each picture in the order of the file
  std::vector<bool> keys;          ///< whether it needs no other
  std::vector<double> brightness;  ///< mean of luma, 0..255, of each decoded picture
};

inline void Decode(AVCodecContext* codec, const AVPacket* packet, AVFrame* frame, VideoContent& content) {
  ASSERT_EQ(avcodec_send_packet(codec, packet), 0);
  while (avcodec_receive_frame(codec, frame) == 0) {
    double sum = 0;
    for (int v = 0; v < frame->height; ++v)
      for (int u = 0; u < frame->width; ++u) sum += frame->data[0][v * frame->linesize[0] + u];
    content.brightness.push_back(sum / (frame->width * frame->height));
  }
}

inline VideoContent ReadVideo(const Path& path) {
  VideoContent content;
  AVFormatContext* file = nullptr;
  if (avformat_open_input(&file, path.c_str(), nullptr, nullptr) < 0) {
    ADD_FAILURE() << "no video: " << path;
    return content;
  }
  EXPECT_GE(avformat_find_stream_info(file, nullptr), 0);
  const AVStream* stream = file->streams[0];
  AVCodecContext* codec = avcodec_alloc_context3(avcodec_find_decoder(stream->codecpar->codec_id));
  avcodec_parameters_to_context(codec, stream->codecpar);
  EXPECT_EQ(avcodec_open2(codec, nullptr, nullptr), 0);
  content.width = codec->width;
  content.height = codec->height;
  AVPacket* packet = av_packet_alloc();
  AVFrame* frame = av_frame_alloc();
  while (av_read_frame(file, packet) >= 0) {
    EXPECT_EQ(packet->pts, packet->dts) << "no picture is shown out of order";
    content.times.push_back(static_cast<double>(packet->pts) * stream->time_base.num / stream->time_base.den);
    content.keys.push_back((packet->flags & AV_PKT_FLAG_KEY) != 0);
    Decode(codec, packet, frame, content);
    av_packet_unref(packet);
  }
  Decode(codec, nullptr, frame, content);
  av_frame_free(&frame);
  av_packet_free(&packet);
  avcodec_free_context(&codec);
  avformat_close_input(&file);
  return content;
}

}  // namespace etude::video
