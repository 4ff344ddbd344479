// A finger: its tracked pose is that of a transform (a joint of a tracked hand); what it feels is read after every step.
using UnityEngine;

[AddComponentMenu("Palpate/Finger")]
public class PalpateFinger : MonoBehaviour
{
    [Tooltip("Its name in the scene")]
    public string finger = "index";
    [Tooltip("What it follows, as it is turned: x to the tip, y to the nail. Joints of a tracked hand are turned otherwise: PalpateHand takes those. Nothing: the hand, or its track in the scene")]
    public Transform follows;

    /// <summary>Net contact force on the skin [N], contact area [m^2].</summary>
    public Vector3 Force { get; private set; }
    public float Area { get; private set; }

    PalpateWorld world;
    int index;

    internal void Begin(PalpateWorld world)
    {
        this.world = world;
        index = world.World.FindFinger(finger);
    }

    internal void Send()
    {
        if (follows == null) return;
        Vector3 p = world.Place(follows);
        Quaternion q = world.Turn(follows);
        world.World.SetFingerPose(index, Palpate.Coordinates.PoseFromUnity(p.x, p.y, p.z, q.x, q.y, q.z, q.w));
    }

    internal void Receive()
    {
        Palpate.FingerState state = world.World.Finger(index);
        float x, y, z, w;
        Palpate.Coordinates.ToUnity(state.Force[0], state.Force[1], state.Force[2], out x, out y, out z);
        Force = new Vector3(x, y, z);
        Area = (float)state.ContactArea;
        double[] bone = state.BonePose;
        Palpate.Coordinates.ToUnity(bone[0], bone[1], bone[2], out x, out y, out z);
        transform.localPosition = new Vector3(x, y, z);
        Palpate.Coordinates.RotationToUnity(bone[3], bone[4], bone[5], bone[6], out x, out y, out z, out w);
        transform.localRotation = new Quaternion(x, y, z, w);
    }
}
