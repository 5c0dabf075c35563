// A process with DDS Security, in plain Fast DDS 2: writes and reads topics with the files of an enclave.
//
//   peer ENCLAVE DOMAIN SECONDS [w:TOPIC | r:TOPIC]...
//
// ENCLAVE is a directory, or - for a process without security. It says on standard output whether it could be made,
// then for each topic whether it may write or read it, then what it received. It ends after SECONDS, or as soon as
// it has received something on every topic that it reads.

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <map>
#include <memory>
#include <string>
#include <thread>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using Clock = std::chrono::steady_clock;

// A number of four bytes, after the four that say how it is written.
struct NumberType : TopicDataType {
  NumberType() {
    setName("Number");
    m_typeSize = 8;
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    const unsigned char little_endian[4] = {0, 1, 0, 0};
    std::memcpy(payload->data, little_endian, 4);
    std::memcpy(payload->data + 4, data, 4);
    payload->length = 8;
    return true;
  }
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    std::memcpy(data, payload->data + 4, 4);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void*) override {
    return [] { return 8u; };
  }
  void* createData() override { return new uint32_t(0); }
  void deleteData(void* data) override { delete static_cast<uint32_t*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

// Plain UDP, and what rmw_fastrtps sets for an enclave.
DomainParticipantQos participant_qos(const std::string& enclave) {
  DomainParticipantQos qos;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>());
  if (enclave == "-") return qos;
  auto& properties = qos.properties().properties();
  const std::string authentication = "dds.sec.auth.builtin.PKI-DH.";
  const std::string access = "dds.sec.access.builtin.Access-Permissions.";
  auto file = [&](const char* name) { return "file://" + enclave + "/" + name; };
  properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
  properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
  properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
  properties.emplace_back(authentication + "identity_ca", file("identity_ca.cert.pem"));
  properties.emplace_back(authentication + "identity_certificate", file("cert.pem"));
  properties.emplace_back(authentication + "private_key", file("key.pem"));
  properties.emplace_back(access + "permissions_ca", file("permissions_ca.cert.pem"));
  properties.emplace_back(access + "governance", file("governance.p7s"));
  properties.emplace_back(access + "permissions", file("permissions.p7s"));
  return qos;
}

template <typename Qos>
Qos reliable_and_latched(Qos qos) {
  qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  qos.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
  return qos;
}

int main(int, char** arguments) {
  Log::ClearConsumers();  // Fast DDS speaks on standard output too, in the middle of our lines
  const auto deadline = Clock::now() + std::chrono::duration<double>(std::atof(arguments[3]));
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(
      std::atoi(arguments[2]), participant_qos(arguments[1]));
  std::cout << "\nparticipant " << (participant ? "made" : "refused") << std::endl;
  if (!participant) return EXIT_SUCCESS;

  TypeSupport(new NumberType).register_type(participant);
  auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  std::map<std::string, DataWriter*> writers;
  std::map<std::string, DataReader*> readers;
  for (char** argument = arguments + 4; *argument; ++argument) {
    const std::string name = *argument + 2;
    const bool writes = **argument == 'w';
    auto* topic = dynamic_cast<Topic*>(participant->lookup_topicdescription(name));
    if (!topic) topic = participant->create_topic(name, "Number", TOPIC_QOS_DEFAULT);
    auto* writer = writes ? publisher->create_datawriter(topic, reliable_and_latched(DATAWRITER_QOS_DEFAULT)) : nullptr;
    auto* reader = writes ? nullptr : subscriber->create_datareader(topic, reliable_and_latched(DATAREADER_QOS_DEFAULT));
    std::cout << "\n" << *argument << " " << (writer || reader ? "allowed" : "refused") << std::endl;
    if (writer) writers[name] = writer;
    if (reader) readers[name] = reader;
  }

  uint32_t number = 0;
  for (auto& writer : writers) writer.second->write(&number);
  bool waiting = !writers.empty() || !readers.empty();
  while (waiting && Clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    waiting = !writers.empty();
    for (auto reader = readers.begin(); reader != readers.end();) {
      SampleInfo info;
      const bool received = reader->second->take_next_sample(&number, &info) == ReturnCode_t::RETCODE_OK && info.valid_data;
      if (received) std::cout << "\nr:" << reader->first << " received" << std::endl;
      reader = received ? readers.erase(reader) : std::next(reader);
    }
    waiting = waiting || !readers.empty();
  }
  std::_Exit(EXIT_SUCCESS);  // the destructors of Fast DDS take seconds
}
