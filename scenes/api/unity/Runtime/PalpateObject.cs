// An object: its transform follows palpate's, or, where no forces move it and `moved` is set, the other way round.
using UnityEngine;

[AddComponentMenu("Palpate/Object")]
public class PalpateObject : MonoBehaviour
{
    [Tooltip("Its name in the scene")]
    public string thing = "ball";
    [Tooltip("This transform moves it; only where it has no mass")]
    public bool moved;

    Palpate.World world;
    int index;

    internal void Begin(Palpate.World world)
    {
        this.world = world;
        index = world.FindObject(thing);
    }

    internal void Send()
    {
        if (!moved) return;
        Vector3 p = transform.localPosition;
        Quaternion q = transform.localRotation;
        world.SetObjectPose(index, Palpate.Coordinates.PoseFromUnity(p.x, p.y, p.z, q.x, q.y, q.z, q.w));
    }

    internal void Receive()
    {
        if (moved) return;
        double[] pose = world.Object(index).Pose;
        float x, y, z, w;
        Palpate.Coordinates.ToUnity(pose[0], pose[1], pose[2], out x, out y, out z);
        transform.localPosition = new Vector3(x, y, z);
        Palpate.Coordinates.RotationToUnity(pose[3], pose[4], pose[5], pose[6], out x, out y, out z, out w);
        transform.localRotation = new Quaternion(x, y, z, w);
    }
}
